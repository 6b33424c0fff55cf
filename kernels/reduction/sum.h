// Sums over a batch in a fixed order: the second half of every kernel that leaves partial sums.
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// Bytes of the partial sums of a kernel over `rows` rays or points that leaves `columns` floats a workgroup of 64.
constexpr uint64_t partial_bytes(uint32_t rows, uint32_t columns = 1) {
  return uint64_t(padded_points(rows) / point_padding) * columns * 4;
}

struct SumArgs {
  const char* name = "sum of partials";  // in the profile
  uint32_t rows = 0;                     // at most 4 million
  uint32_t columns = 1;
  BufferSlice partials;    // [rows][columns] float
  BufferSlice sums;        // float; elements sum_index … sum_index + columns − 1 are added to (+=)
  uint32_t sum_index = 0;  // floats from the start of `sums`
};

void record_sum(Commands& commands, const SumArgs& args);

}  // namespace arah
