// One Adam step over a range of the flat parameter buffers (reference::adam_step, update_average; ARAH.md section 7).
#pragma once

#include "kernels/optimizer/outer_product.h"
#include "kernels/vulkan/commands.h"
#include "shaders/shared/optimizer.h"

namespace arah {

// p: a parameter, g: its gradient after clipping.
//   g += λ p,   m = β₁ m + (1 − β₁) g,   v = β₂ v + (1 − β₂) g²,   p −= rate / (1 − β₁ᵗ) m / (√(v / (1 − β₂ᵗ)) + ε),
//   average += (1 − decay)(p − average).
struct AdamArgs {
  uint32_t step = 1;  // t, counted from 1
  double rate = 0;    // learning rate of this step
  double beta1 = 0.9, beta2 = 0.999, epsilon = 1e-8;
  double weight_decay = 0;   // λ
  double average_decay = 0;  // of the moving average
  BufferSlice
      parameters;         // float, as all below: the same multiple of 64 numbers each; may exceed what is bound at once
  BufferSlice gradients;  // not changed, except lazy ones; empty where `outer` gives them
  OuterProduct outer;     // the gradient of a matrix [rows][columns], which the range holds up to its padding
  BufferSlice first_moments;
  BufferSlice second_moments;
  BufferSlice averages;  // empty: none is kept
  // shared::GradientNorm (record_clip_scale): the gradient is multiplied by its scale; where its norm is not finite the
  // range is left as it is. Empty: the gradient is taken as it is.
  BufferSlice norms;
  uint32_t norm_index = 0;
  // For feature grids: gradients are int32, 1 of which stands for gradient_unit. Groups of 8 numbers whose words are
  // all 0 are left as they are, moments and average included; the words of the others are set back to 0.
  bool lazy = false;
  float gradient_unit = 1;
};

// Throws std::invalid_argument where the ranges differ in length, are no multiple of 64 numbers, an outer product does not fit
// its range, or step is 0.
void record_adam(Commands& commands, const AdamArgs& args);

}  // namespace arah
