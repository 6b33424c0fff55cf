// Signed distance of each node of a shell grid to the posed template, taken to its nearest vertex:
// sign((p − v) · n_v) |p − v|, positive outside. One invocation writes one node; the padding after the last node is
// written with the last node's value.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/rays.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { ShellDistanceConstants c; };
layout(binding = 0, scalar) readonly buffer Nearest { uint nearest[]; };
layout(binding = 1, scalar) readonly buffer Vertices { vec4 vertices[]; };
layout(binding = 2, scalar) readonly buffer Normals { vec4 normals[]; };
layout(binding = 3, scalar) writeonly buffer Distances { float distances[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  uvec3 nodes = c.grid.nodes;
  uint node = min(index, nodes.x * nodes.y * nodes.z - 1u);
  uint row = node / nodes.x;
  uvec3 at = uvec3(node - row * nodes.x, row % nodes.y, row / nodes.y);
  uint vertex = min(nearest[node], c.vertices - 1u);
  vec3 from_vertex = c.grid.origin + c.grid.cell * vec3(at) - vertices[vertex].xyz;
  float size = sqrt(dot(from_vertex, from_vertex));
  distances[index] = dot(from_vertex, normals[vertex].xyz) < 0.0 ? -size : size;
}
