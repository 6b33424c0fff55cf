// How the raw parameters of a linear layer become the weights that are multiplied (pack_weights) and how gradients come back
// (unpack_gradient). Raw: W [outputs][inputs] row-major, bias [outputs]. With
//   weight norm  s_m = g_m / |W_m|, where |W_m| runs over the whole row,       shift_m = b_m
//   FiLM         s_m = omega · gamma_m,                                        shift_m = omega · (gamma_m b_m + eta_m)
//   neither      s_m = omega,                                                  shift_m = omega · b_m
// the layer computes s_m W_m·x + shift_m. Inputs that are constant over the batch (a frame's latent code: raw columns
// [constant_first, constant_first + constant_count)) are folded into the bias: shift_m += s_m W_m[constant]·code.
// The other columns are `streamed`: effective row k reads streamed column k below gap_first, none (zero) inside the gap
// that aligns a second input, and k − gap_count above it.
#ifndef ARAH_LIB_PARAMETERISATION_GLSL
#define ARAH_LIB_PARAMETERISATION_GLSL

const int KIND_PLAIN = 0, KIND_WEIGHT_NORM = 1, KIND_FILM = 2;

layout(push_constant, scalar) uniform Constants {
  uint inputs, outputs;                 // raw
  uint padded_inputs, padded_outputs;   // effective
  uint constant_first, constant_count;
  uint gap_first, gap_count;
  float omega;
};

// Raw column of effective row k, or −1 for padding.
int raw_column(uint k) {
  if (k >= gap_first && k < gap_first + gap_count) return -1;
  const uint streamed = k < gap_first ? k : k - gap_count;
  if (streamed >= inputs - constant_count) return -1;
  return int(streamed < constant_first ? streamed : streamed + constant_count);
}

#endif
