// The mask loss of surface rendering (reference::mask_loss; paper, appendix "Mask Loss").
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// Σ q BCE(mask, sigmoid(−α f)) / (α N) over rays, f each one's least distance.
struct MaskLossArgs {
  uint32_t rays = 0;
  float normaliser = 1;  // N: rays of the whole step, whatever the number of those here
  float weight = 0;
  float alpha = 50;    // above 0, per cube unit
  Matrix sdf;          // its first column: f, cube units; stride and column are multiples of 4, as d_sdf's
  BufferSlice points;  // [rays] vec4; w > 0: the ray has a least distance and is in the loss
  BufferSlice masks;   // [rays] float, 0 to 1
  Matrix d_sdf;        // out (=): the weighted gradient in the first column, 0 in the others and in padding rows
  uint32_t d_sdf_columns = channel_padding;  // written, from d_sdf.column on; a multiple of 4
  BufferSlice losses;    // float: the value and its derivative to α, both without `weight`, are added (+=) at `slot` and slot + 1
  uint32_t slot = 0;
  BufferSlice partials;  // scratch: partial_bytes(rays, 2) (kernels/reduction/sum.h)
  BufferSlice weights;   // [rays] float q, at least 0; empty: 1 each
};

// Two launches: the rays and the sums over them, in a fixed order. Throws std::invalid_argument where a stride, column or
// width is no multiple of 4.
void record_mask_loss(Commands& commands, const MaskLossArgs& args);

}  // namespace arah
