// Raw parameters → effective weights, packed twice: for X W (tiles of outputs) and for dY Wᵀ (tiles of inputs).
// One invocation owns one effective output m: its norm, its bias, its column of both packings. See lib/parameterisation.glsl.
// A packing with R rows and C columns in tiles of width t: tile j at float j (R + 1) t, row 0 the bias (zero in the transposed
// one), row 1 + r the t weights of row r.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(constant_id = 0) const int KIND = 0;
layout(constant_id = 1) const uint TILE = 16;             // width of forward tiles
layout(constant_id = 2) const uint TRANSPOSED_TILE = 16;  // width of transposed tiles
#include "lib/parameterisation.glsl"
layout(binding = 0, scalar) restrict readonly buffer Weights { float weights[]; };
layout(binding = 1, scalar) restrict readonly buffer Bias { float bias[]; };
layout(binding = 2, scalar) restrict readonly buffer First { float first[]; };    // weight norm: g; FiLM: gamma
layout(binding = 3, scalar) restrict readonly buffer Shift { float shift[]; };    // FiLM: eta
layout(binding = 4, scalar) restrict readonly buffer Code { float code[]; };      // the constant inputs
layout(binding = 5, scalar) restrict writeonly buffer Forward { float forward_pack[]; };
layout(binding = 6, scalar) restrict writeonly buffer Transposed { float transposed_pack[]; };
layout(binding = 7, scalar) restrict writeonly buffer Scales { vec2 scales[]; };  // (s_m, 1 / |W_m|) for unpack_gradient

void main() {
  const uint m = gl_GlobalInvocationID.x;
  const bool real = m < outputs;
  const uint row = min(m, outputs - 1u);
  float scale = omega, inverse_norm = 1.0, total_bias = omega * bias[row];
  if (KIND == KIND_WEIGHT_NORM) {
    float squares = 0.0;
    for (uint k = 0; k < inputs; ++k) squares += weights[row * inputs + k] * weights[row * inputs + k];
    inverse_norm = squares > 0.0 ? 1.0 / sqrt(squares) : 0.0;
    scale = first[row] * inverse_norm;
    total_bias = bias[row];
  } else if (KIND == KIND_FILM) {
    scale = omega * first[row];
    total_bias = omega * (first[row] * bias[row] + shift[row]);
  }
  float constant = 0.0;
  for (uint j = 0; j < constant_count; ++j) constant += weights[row * inputs + constant_first + j] * code[j];
  total_bias += scale * constant;

  if (m < padded_outputs) {
    const uint forward_base = m / TILE * (padded_inputs + 1u) * TILE + m % TILE;
    forward_pack[forward_base] = real ? total_bias : 0.0;
    for (uint k = 0; k < padded_inputs; ++k) {
      const int column = raw_column(k);
      const float w = real && column >= 0 ? scale * weights[row * inputs + uint(max(column, 0))] : 0.0;
      forward_pack[forward_base + (1u + k) * TILE] = w;
      const uint transposed_base = k / TRANSPOSED_TILE * (padded_outputs + 1u) * TRANSPOSED_TILE + k % TRANSPOSED_TILE;
      transposed_pack[transposed_base + (1u + m) * TRANSPOSED_TILE] = w;
      if (m == 0u) transposed_pack[transposed_base] = 0.0;
    }
    scales[m] = vec2(scale, inverse_norm);
  }
}
