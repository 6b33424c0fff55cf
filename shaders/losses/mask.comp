// The mask loss of surface rendering (paper, appendix "Mask Loss"; kernels/reference/losses.h): the binary cross entropy of
// sigmoid(−α f) with the mask, over α N, f a ray's least distance in cube units. One invocation takes one ray: reads f where
// the ray has one, its mask and where WEIGHTED its own weight; writes (=) the gradient times the loss's weight, channels
// beyond the first and padding rows as 0. Each workgroup leaves its sums of the loss and of its derivative to α, without that
// weight, in `partials`.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/stable.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/losses.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint WEIGHTED = 0u;  // 0: `weights` is not read
layout(constant_id = 1) const uint d_sdf_texels = 2u;

layout(push_constant, scalar) uniform Constants { MaskLossConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer sdf;
layout(binding = 1, rgba32f) uniform readonly imageBuffer points;  // w > 0: the ray has a least distance
layout(binding = 2, scalar) readonly buffer Masks { float masks[]; };
layout(binding = 3, scalar) writeonly buffer DSdf { vec4 d_sdf[]; };
layout(binding = 4, scalar) writeonly buffer Partials { vec2 partials[]; };
layout(binding = 5, scalar) readonly buffer Weights { float weights[]; };

float softplus(float x) { return max(x, 0.0) + stable_log1p(exp(-abs(x))); }

void main() {
  uint index = gl_GlobalInvocationID.x;
  uint ray = min(index, c.rays - 1u);
  bool counts = index < c.rays && imageLoad(points, int(ray)).w > 0.0;
  float f = imageLoad(sdf, int(ray * c.stride + c.column)).x;
  float mask = masks[ray];
  float of_ray = WEIGHTED != 0u ? weights[ray] * c.inverse_normaliser : c.inverse_normaliser;
  float x = c.alpha * f;
  float cross_entropy = mask * softplus(x) + (1.0 - mask) * softplus(-x);
  float slope = mask * stable_sigmoid(x) - (1.0 - mask) * stable_sigmoid(-x);  // of the cross entropy / α with f
  uint texel = index * c.d_stride + c.d_column;
  d_sdf[texel] = counts ? vec4(c.weight * of_ray * slope, 0.0, 0.0, 0.0) : vec4(0.0);
  for (uint padding = 1u; padding < d_sdf_texels; ++padding) d_sdf[texel + padding] = vec4(0.0);
  float loss = cross_entropy / c.alpha;
  vec2 sums = workgroup_sum(counts ? of_ray * vec2(loss, (f * slope - loss) / c.alpha) : vec2(0.0));
  if (gl_LocalInvocationIndex == 0u) partials[gl_WorkGroupID.x] = sums;
}
