// Penalties on the sdf's values (reference::off_surface_loss, inside_loss, on_surface_loss, near_zero_loss; ARAH.md sections 7 and 10).
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

enum class SdfPenalty {
  off_surface,  // Σ exp(−100 f) / N over points well outside the body; infinite for f < −0.88
  inside,       // Σ sigmoid(5000 f) / N over points well inside it
  on_surface,   // Σ |f| / N over points of the surface
  near_zero,    // Σ exp(−100 |f|) / N over points anywhere else
};

struct SdfPenaltyArgs {
  SdfPenalty penalty = SdfPenalty::off_surface;
  uint32_t points = 0;
  float normaliser = 1;  // N: rays of the whole step, whatever the number of points
  float weight = 0;
  Matrix sdf;  // its first column: the sdf network's value f in cube units; any stride
  Matrix
      d_sdf;  // out (=): the weighted gradient in the first column, 0 in the others and in padding rows; multiples of 4
  uint32_t d_sdf_columns = channel_padding;  // written, from d_sdf.column on; a multiple of 4
  BufferSlice losses;                        // float: the unweighted value is added (+=) at `slot`
  uint32_t slot = 0;
  BufferSlice partials;  // scratch: partial_bytes(points) (kernels/reduction/sum.h)
};

// Throws std::invalid_argument where d_sdf's stride, column or width is no multiple of 4.
void record_sdf_penalty(Commands& commands, const SdfPenaltyArgs& args);

}  // namespace arah
