// The way back to U, C and h (kernels/reference/hypernetwork.h): one invocation a number of U, [outputs][rank]. With
// s = Σ_i dW[o][i] V[r][i]: dU[o][r] += h_r s, dC[o][r] += h_r db_o, and partials[o][r] = U[o][r] s + C[o][r] db_o, whose sum
// over o is dh_r.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/elements.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { LowRankConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer d_w;  // [outputs][inputs]
layout(binding = 1, rgba32f) uniform readonly imageBuffer v;    // [rank][inputs]
layout(binding = 2, scalar) readonly buffer DB { float d_b[]; };
layout(binding = 3, scalar) readonly buffer U { float u[]; };
layout(binding = 4, scalar) readonly buffer BiasChange { float bias_change[]; };
layout(binding = 5, scalar) readonly buffer H { float h[]; };
layout(binding = 6, scalar) buffer DU { float d_u[]; };
layout(binding = 7, scalar) buffer DBiasChange { float d_bias_change[]; };
layout(binding = 8, scalar) writeonly buffer Partials { float partials[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  bool within = index < c.outputs * c.rank;
  uint row = min(index / c.rank, c.outputs - 1u), r = index % c.rank;
  float along = 0.0;
  for (uint i = 0u; i < c.inputs; ++i) along += ELEMENT(d_w, row * c.inputs + i) * ELEMENT(v, r * c.inputs + i);
  if (!within) return;
  float coefficient = h[c.h + r];
  d_u[index] += coefficient * along;
  d_bias_change[index] += coefficient * d_b[row];
  partials[index] = u[index] * along + bias_change[index] * d_b[row];
}
