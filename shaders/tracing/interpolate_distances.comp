// Signed distances of canonical points between the nodes of a grid that has them (kernels/tracing/interpolate_distances.h).
// One invocation serves one row: trilinear; outside the grid the nearest place of it answers.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/tracing.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { InterpolateDistancesConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer points;
layout(binding = 1, rgba32f) uniform readonly imageBuffer distances;  // four nodes a texel
layout(binding = 2, scalar) restrict writeonly buffer Interpolated { vec4 interpolated[]; };
#include "lib/shell_distance.glsl"

void main() {
  uint row = gl_GlobalInvocationID.x;
  vec4 point = imageLoad(points, int(row));
  bool inside;
  float value = shell_distance((point.xyz - c.grid.origin) / c.grid.cell, c.grid.nodes, inside);
  interpolated[row] = vec4(row < c.rows ? value : 0.0, 0.0, 0.0, 0.0);
}
