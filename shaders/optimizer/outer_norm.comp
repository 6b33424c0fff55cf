// Parts of the squared norm of a gradient Σ_i a_i b_iᵀ that is never written out: |Σ_i a_i b_iᵀ|² = Σ_ij (a_i·a_j)(b_i·b_j).
// One workgroup takes one pair i ≤ j and leaves one SquaresPartial; those of i = j count the numbers that are NaN or infinite.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/workgroup_sum.glsl"
#include "shared/optimizer.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { OuterNormConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer rows;     // a, zeros after the last
layout(binding = 1, rgba32f) uniform readonly imageBuffer columns;  // b
layout(binding = 2, scalar) writeonly buffer Partials { SquaresPartial partials[]; };

float nonfinite(vec4 values) {
  uvec4 bits = floatBitsToUint(values) & 0x7f800000u;
  return dot(mix(vec4(0.0), vec4(1.0), equal(bits, uvec4(0x7f800000u))), vec4(1.0));
}

void main() {
  // Pairs in the order (0,0), (0,1), (1,1), (0,2), …: the group's number is j (j + 1) / 2 + i.
  uint i = gl_WorkGroupID.x, j = 0u;
  while (i > j) i -= ++j;
  uint lane = gl_LocalInvocationIndex;
  vec2 of_rows = vec2(0.0), of_columns = vec2(0.0);
  for (uint at = lane; at < c.row_texels; at += 64u) {
    vec4 a = imageLoad(rows, int(i * c.row_stride + at));
    of_rows += vec2(dot(a, imageLoad(rows, int(j * c.row_stride + at))), nonfinite(a));
  }
  for (uint at = lane; at < c.column_texels; at += 64u) {
    vec4 b = imageLoad(columns, int(c.first_column + i * c.column_stride + at));
    of_columns += vec2(dot(b, imageLoad(columns, int(c.first_column + j * c.column_stride + at))), nonfinite(b));
  }
  of_rows = workgroup_sum(of_rows);
  of_columns = workgroup_sum(of_columns);
  if (lane == 0u)
    partials[c.first_partial + gl_WorkGroupID.x] =
        SquaresPartial((i == j ? 1.0 : 2.0) * of_rows.x * of_columns.x, i == j ? uint(of_rows.y + of_columns.y) : 0u);
}
