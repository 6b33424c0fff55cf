#include "kernels/reference/watch.h"

#include <cmath>

namespace arah::reference {

Watched watch(std::span<const float> values, uint32_t rows, uint32_t channels, uint32_t stride, uint32_t column, float limit, std::span<const float> counts, std::span<const uint32_t> row_ids,
              uint32_t first_row) {
  Watched found;
  for (uint32_t row = 0; row < rows; ++row) {
    if (!counts.empty() && !(counts[row] > 0)) continue;
    for (uint32_t channel = 0; channel < channels; ++channel) {
      const float value = values[size_t(row) * stride + column + channel];
      if (std::isnan(value)) found.nan += 1;
      else if (std::isinf(value)) found.infinite += 1;
      else if (std::abs(value) > limit) found.beyond += 1;
      else continue;
      const int64_t place = (int64_t{first_row} + (row_ids.empty() ? row : row_ids[row])) * channels + channel;
      if (found.first < 0 || place < found.first) found.first = place;
    }
  }
  return found;
}

}  // namespace arah::reference
