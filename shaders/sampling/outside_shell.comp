// Marks the samples that lie outside the shell around the posed template (kernels/sampling/outside_shell.h). One invocation
// serves one sample: where its point is wanted (w > 0) and the template farther than `outer`, or the point outside the grid, w
// becomes EMPTY.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/empty_sample.h"
#include "shared/sampling.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { OutsideShellConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer points;
layout(binding = 1, rgba32f) uniform readonly imageBuffer distances;  // four nodes a texel
layout(binding = 2, scalar) writeonly buffer Marked { vec4 marked[]; };  // the same memory as `points`
#include "lib/shell_distance.glsl"

void main() {
  uint row = gl_GlobalInvocationID.x;
  vec4 point = imageLoad(points, int(row));
  bool inside;
  float signed_distance = shell_distance((point.xyz - c.grid.origin) / c.grid.cell, c.grid.nodes, inside);
  bool empty = row < c.rows && point.w > 0.0 && !(inside && signed_distance <= c.outer);
  if (empty) marked[row] = vec4(point.xyz, EMPTY);
}
