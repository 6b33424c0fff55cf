// A SIREN layer's parameters of a pose, of low rank (kernels/reference/hypernetwork.h): W = W₀ + Σ_r h_r u_r v_rᵀ, one
// invocation a number; those after the matrix give b = b₀ + C h.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/elements.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { LowRankConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer u;  // [outputs][rank]
layout(binding = 1, rgba32f) uniform readonly imageBuffer v;  // [rank][inputs]
layout(binding = 2, rgba32f) uniform readonly imageBuffer bias_change;  // [outputs][rank]
layout(binding = 3, scalar) readonly buffer H { float h[]; };
layout(binding = 4, scalar) readonly buffer BaseW { float base_w[]; };
layout(binding = 5, scalar) readonly buffer BaseB { float base_b[]; };
layout(binding = 6, scalar) writeonly buffer W { float w[]; };
layout(binding = 7, scalar) writeonly buffer B { float b[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  uint numbers = c.outputs * c.inputs;
  bool of_bias = index >= numbers;
  uint row = of_bias ? min(index - numbers, c.outputs - 1u) : index / c.inputs;
  uint column = of_bias ? 0u : index % c.inputs;
  float sum = 0.0;
  if (of_bias) {
    for (uint r = 0u; r < c.rank; ++r) sum += h[c.h + r] * ELEMENT(bias_change, row * c.rank + r);
    if (index - numbers < c.outputs) b[row] = base_b[row] + sum;
  } else {
    for (uint r = 0u; r < c.rank; ++r) sum += h[c.h + r] * ELEMENT(u, row * c.rank + r) * ELEMENT(v, r * c.inputs + column);
    w[index] = base_w[index] + sum;
  }
}
