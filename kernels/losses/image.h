// Colour and mask losses of rendered rays (reference::color_loss, alpha_loss; ARAH.md section 7).
#pragma once

#include "kernels/vulkan/commands.h"

namespace arah {

struct ImageLossArgs {
  uint32_t rays = 0;
  float normaliser = 1;    // N: rays of the whole step
  float color_weight = 0;  // of Σ |rgb − photograph| / N
  float alpha_weight = 0;  // of the binary cross entropy / N
  BufferSlice colors;      // [rays] vec4 (rgb, Σ w)
  BufferSlice targets;     // [rays] vec4 (photograph's rgb on black, mask in [0, 1]); a negative mask: not in the loss
  BufferSlice d_colors;    // out (=): [padded_points(rays)] vec4: the weighted gradient; padding 0
  BufferSlice losses;      // float: values without the two weights above are added (+=) at `slot` (colour) and slot + 1 (mask)
  uint32_t slot = 0;
  BufferSlice partials;  // scratch: partial_bytes(rays, 2) (kernels/reduction/sum.h)
  BufferSlice weights;   // [rays] float, at least 0: each ray's terms and gradient are multiplied by its own; empty: by 1
};

// Two launches: the rays and the sums over them, in a fixed order.
void record_image_loss(Commands& commands, const ImageLossArgs& args);

}  // namespace arah
