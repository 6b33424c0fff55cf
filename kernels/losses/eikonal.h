// Eikonal loss Σ | |∇f| − 1 | / N (reference::eikonal_loss; ARAH.md section 7).
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

struct EikonalLossArgs {
  uint32_t points = 0;
  float normaliser = 1;  // N: rays of the whole step, whatever the number of points
  float weight = 0;
  Matrix gradients;    // [points][3]: ∇f of the sdf network per cube unit; stride and column are multiples of 4
  Matrix d_gradients;  // out (=): the weighted gradient to it in 3 channels; 0 in the others and in padding rows
  uint32_t d_columns = channel_padding;  // written, from d_gradients.column on; a multiple of 4
  BufferSlice losses;                    // float: the unweighted value is added (+=) at `slot`
  uint32_t slot = 0;
  BufferSlice partials;  // scratch: partial_bytes(points) (kernels/reduction/sum.h)
};

// Throws std::invalid_argument where a stride, column or width is no multiple of 4.
void record_eikonal_loss(Commands& commands, const EikonalLossArgs& args);

}  // namespace arah
