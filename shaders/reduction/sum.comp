// Adds up a table of partial sums, column by column, in a fixed order: sums[sum_index + column] += Σ_row partials.
// One workgroup adds one column.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/workgroup_sum.glsl"
#include "shared/reduction.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { SumConstants c; };
layout(binding = 0, scalar) readonly buffer Partials { float partials[]; };  // [rows][columns]
layout(binding = 1, scalar) buffer Sums { float sums[]; };

void main() {
  uint column = gl_WorkGroupID.x;
  float own = 0.0;
  for (uint row = gl_LocalInvocationIndex; row < c.rows; row += 64u) own += partials[row * c.columns + column];
  float sum = workgroup_sum(own);
  if (gl_LocalInvocationIndex == 0u) sums[c.sum_index + column] += sum;
}
