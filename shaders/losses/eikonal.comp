// Eikonal loss Σ | |∇f| − 1 | / N (ARAH.md section 7). One invocation takes one point: reads ∇f per cube unit, writes
// (=) the weighted gradient to it, channels beyond the third and padding rows as 0. Each workgroup leaves its unweighted sum in `partials`.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/stable.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/losses.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { EikonalConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer gradients;
layout(binding = 1, scalar) writeonly buffer DGradients { vec4 d_gradients[]; };
layout(binding = 2, scalar) writeonly buffer Partials { float partials[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  bool counts = index < c.points;
  vec3 gradient = imageLoad(gradients, int(min(index, c.points - 1u) * c.stride + c.column)).xyz;
  float factor = factor_for_squares(gradient);
  gradient *= factor;
  float scaled_size = sqrt(dot(gradient, gradient)), size = scaled_size / factor;
  vec3 d_gradient = scaled_size > 0.0 ? (c.weight * c.inverse_normaliser * sign(size - 1.0) / scaled_size) * gradient : vec3(0.0);
  // A NaN gradient compares as not above 0; it must reach the optimiser's guard, not vanish.
  d_gradient = isnan(size) ? vec3(size) : d_gradient;
  uint texel = index * c.d_stride + c.d_column;
  d_gradients[texel] = counts ? vec4(d_gradient, 0.0) : vec4(0.0);
  for (uint padding = 1u; padding < c.d_texels; ++padding) d_gradients[texel + padding] = vec4(0.0);
  float sum = workgroup_sum(counts ? abs(size - 1.0) * c.inverse_normaliser : 0.0);
  if (gl_LocalInvocationIndex == 0u) partials[gl_WorkGroupID.x] = sum;
}
