// What the watch over a tensor's numbers has to find (kernels/watch/scan.h).
#pragma once

#include <cstdint>
#include <span>

namespace arah::reference {

struct Watched {
  uint32_t nan = 0, infinite = 0, beyond = 0;  // beyond: finite, with |x| > limit
  int64_t first = -1;                          // place of the first of them; -1: none
};

// values: [rows][stride], of which `channels` from `column` on are looked at. counts: by row, 0: not looked at; empty: all are.
// row_ids: by row, its number; empty: 0, 1, …. Place of channel k of row r: (first_row + row_ids[r]) · channels + k.
Watched watch(std::span<const float> values, uint32_t rows, uint32_t channels, uint32_t stride, uint32_t column, float limit, std::span<const float> counts, std::span<const uint32_t> row_ids,
              uint32_t first_row);

}  // namespace arah::reference
