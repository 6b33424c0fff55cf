// The gradient of a matrix that one vector at a time went through: Σ_i a_i b_iᵀ, with one pair of vectors a frame of the step.
// Of the hypernetwork's last layers it would be as large as they are (85 million numbers), so that it is never written out:
// its norm comes from the vectors' products, and Adam forms each number where it needs it (adam.h).
#pragma once

#include "kernels/vulkan/commands.h"
#include "shaders/shared/optimizer.h"

namespace arah {

struct OuterProduct {
  uint32_t pairs = 0;  // 0: none
  // Both are read as texels: strides are multiples of 4 floats.
  BufferSlice a;          // float [pairs][row_stride]: dL/d(output); zeros up to the next multiple of 4 after the last row
  uint32_t rows = 0, row_stride = 0;
  BufferSlice b;          // float [pairs][column_stride]: the input, from first_column (a multiple of 4) of each row on
  uint32_t columns = 0, first_column = 0, column_stride = 0;  // columns: a multiple of 8
};

// Partials that record_outer_norm leaves.
constexpr uint32_t outer_partials(uint32_t pairs) { return pairs * (pairs + 1) / 2; }

// Squared norm → `partials` (shared::SquaresPartial, =) from first_partial on, for record_clip_scale.
void record_outer_norm(Commands& commands, const OuterProduct& gradient, const BufferSlice& partials, uint32_t first_partial);

}  // namespace arah
