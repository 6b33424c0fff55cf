// The way back to V (kernels/reference/hypernetwork.h): dV[r][i] += h_r Σ_o U[o][r] dW[o][i], one invocation a number of V.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/elements.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { LowRankConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer d_w;  // [outputs][inputs]
layout(binding = 1, rgba32f) uniform readonly imageBuffer u;    // [outputs][rank]
layout(binding = 2, scalar) readonly buffer H { float h[]; };
layout(binding = 3, scalar) buffer DV { float d_v[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  uint r = min(index / c.inputs, c.rank - 1u), column = index % c.inputs;
  float sum = 0.0;
  for (uint o = 0u; o < c.outputs; ++o) sum += ELEMENT(u, o * c.rank + r) * ELEMENT(d_w, o * c.inputs + column);
  if (index < c.rank * c.inputs) d_v[index] += h[c.h + r] * sum;
}
