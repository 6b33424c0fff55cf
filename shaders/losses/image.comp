// Colour and mask losses of the rays (ARAH.md section 7; kernels/reference/losses.h): Σ |rgb − photograph| / N and the
// binary cross entropy of Σw, clamped to [1e-3, 1 − 1e-3], with the mask / N. One invocation takes one ray: reads its
// (rgb, Σw) and (photograph, mask), writes (=) the gradient times the losses' weights; a ray with a negative mask is not in
// the loss. Each workgroup leaves its two sums, without those weights, in `partials`. WEIGHTED: a ray counts by its own weight,
// in gradient and sums.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/finite.glsl"
#include "lib/stable.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/losses.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint WEIGHTED = 0u;  // 0: `weights` is not read

layout(push_constant, scalar) uniform Constants { ImageLossConstants c; };
layout(binding = 0, scalar) readonly buffer Colors { vec4 colors[]; };
layout(binding = 1, scalar) readonly buffer Targets { vec4 targets[]; };
layout(binding = 2, scalar) writeonly buffer DColors { vec4 d_colors[]; };
layout(binding = 3, scalar) writeonly buffer Partials { vec2 partials[]; };
layout(binding = 4, scalar) readonly buffer Weights { float weights[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  uint ray = min(index, c.rays - 1u);
  vec4 color = colors[ray];
  vec4 target = targets[ray];
  float mask = target.w;
  bool counts = index < c.rays && mask >= 0.0;

  vec3 difference = color.xyz - target.xyz;
  float alpha = clamped(color.w, 1e-3, 1.0 - 1e-3);
  float cross_entropy = -(mask * stable_log1p(alpha - 1.0) + (1.0 - mask) * stable_log1p(-alpha));
  float d_alpha = alpha == color.w ? (1.0 - mask) / (1.0 - alpha) - mask / alpha : 0.0;
  vec4 gradient = vec4(c.color_weight * sign(difference), c.alpha_weight * d_alpha) * c.inverse_normaliser;
  // sign and the comparison would hide a NaN, which must reach the optimiser's guard.
  gradient = mix(gradient, color, is_nan(color));
  vec2 losses = vec2(dot(abs(difference), vec3(1.0)), cross_entropy) * c.inverse_normaliser;
  if (WEIGHTED != 0u) {
    float weight = weights[ray];
    gradient *= weight;
    losses *= weight;
  }
  d_colors[index] = counts ? gradient : vec4(0.0);
  vec2 sums = workgroup_sum(counts ? losses : vec2(0.0));
  if (gl_LocalInvocationIndex == 0u) partials[gl_WorkGroupID.x] = sums;
}
