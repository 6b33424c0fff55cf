// Canonical points of posed ones where the weights are given there (Skinning::backward of the avatar).
#pragma once

#include "kernels/vulkan/commands.h"

namespace arah {

// x = T⁻¹ x_bar (reference::inverse_blend). Zeros where x_bar is not wanted, in padding rows, and where T has no inverse in
// float32 (|det| ≤ 4e-7 · the product of its rows' lengths) or the result is not finite.
struct InverseBlendArgs {
  uint32_t points = 0;
  BufferSlice targets;     // vec4 by point: x_bar − t, metres; w > 0 where wanted
  BufferSlice transforms;  // three vec4 by point: the rows of T = Σ_b w_b B_b, of record_lbs
  BufferSlice canonical;   // out, vec4 by point: w = 1 where found
};
void record_inverse_blend(Commands& commands, const InverseBlendArgs& args);

}  // namespace arah
