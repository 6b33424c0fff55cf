// Positions of a shell grid's nodes: the points whose nearest template vertex is wanted.
// One invocation writes one node as (position, 1); the padding after the last node repeats it.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/shell_grid.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { ShellGrid grid; };
layout(binding = 0, scalar) writeonly buffer Points { vec4 points[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  uint node = min(index, grid.nodes.x * grid.nodes.y * grid.nodes.z - 1u);
  uint row = node / grid.nodes.x;
  uvec3 at = uvec3(node - row * grid.nodes.x, row % grid.nodes.y, row / grid.nodes.y);
  points[index] = vec4(grid.origin + grid.cell * vec3(at), 1.0);
}
