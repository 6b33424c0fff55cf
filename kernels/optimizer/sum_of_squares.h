// First level of a gradient's norm: partial sums of squares, and a count of numbers that are NaN or infinite.
#pragma once

#include "kernels/vulkan/commands.h"
#include "shaders/shared/optimizer.h"

namespace arah {

// Partials of a range of `count` numbers, 8 bytes (shared::SquaresPartial) each.
constexpr uint32_t squares_partials(uint64_t count) {
  return static_cast<uint32_t>((count + shared::squares_tile - 1) / shared::squares_tile);
}

struct SumOfSquaresArgs {
  BufferSlice gradients;       // float; a multiple of 64 of them. Longer than a device binds at once is possible
  BufferSlice partials;        // out (=): shared::SquaresPartial, squares_partials(count) from first_partial on
  uint32_t first_partial = 0;  // for groups of several ranges, one after the other
};

// Throws std::invalid_argument where the count is no multiple of 64.
void record_sum_of_squares(Commands& commands, const SumOfSquaresArgs& args);

}  // namespace arah
