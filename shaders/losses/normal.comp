// Normal loss Σ (1 − cos(∇f, n)) / N over points of the surface (ARAH.md section 10). One invocation takes one point: reads
// ∇f per cube unit and the outward unit normal n, adds (+=) the weighted gradient to what the eikonal loss has written
// for the same point; padding rows are left. Each workgroup leaves its unweighted sum in `partials`.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/stable.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/losses.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { NormalLossConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer gradients;
layout(binding = 1, rgba32f) uniform readonly imageBuffer normals;
layout(binding = 2, scalar) buffer DGradients { vec4 d_gradients[]; };
layout(binding = 3, scalar) writeonly buffer Partials { float partials[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  bool counts = index < c.points;
  uint point = min(index, c.points - 1u);
  vec3 gradient = imageLoad(gradients, int(point * c.stride + c.column)).xyz;
  vec3 normal = imageLoad(normals, int(point)).xyz;
  float factor = factor_for_squares(gradient);
  gradient *= factor;
  float size = sqrt(dot(gradient, gradient));  // times `factor`
  // size > 0 is false for a NaN, which the eikonal loss has handed on already.
  vec3 direction = size > 0.0 ? gradient / size : vec3(0.0);
  float cosine = dot(direction, normal);
  vec3 d_gradient = size > 0.0 ? (c.weight * c.inverse_normaliser / size * factor) * (cosine * direction - normal) : vec3(0.0);
  uint texel = index * c.d_stride + c.d_column;
  if (counts) d_gradients[texel] += vec4(d_gradient, 0.0);
  float sum = workgroup_sum(counts ? (1.0 - cosine) * c.inverse_normaliser : 0.0);
  if (gl_LocalInvocationIndex == 0u) partials[gl_WorkGroupID.x] = sum;
}
