// What the linear layer's kernels read, made on the CPU.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/linear/linear.h"
#include "kernels/reference/linear.h"

namespace arah {

// Effective weights in double precision: w [inputs][outputs], b [outputs], both padded.
struct EffectiveWeights {
  uint32_t inputs = 0;
  uint32_t outputs = 0;
  std::vector<double> w;
  std::vector<double> b;
};

// The packing that pack_weights documents: tiles of columns, in each first a row `first_row`, then the rows of the
// matrix.
inline std::vector<float> packed(const std::vector<double>& matrix, const std::vector<double>& first_row, uint32_t rows,
                                 uint32_t columns) {
  const uint32_t tile = linear_tile(rows, columns);
  std::vector<float> result;
  for (uint32_t first = 0; first < columns; first += tile) {
    for (uint32_t c = 0; c < tile; ++c) result.push_back(static_cast<float>(first_row[first + c]));
    for (uint32_t r = 0; r < rows; ++r)
      for (uint32_t c = 0; c < tile; ++c) result.push_back(static_cast<float>(matrix[size_t(r) * columns + first + c]));
  }
  return result;
}

inline std::vector<float> packed_forward(const EffectiveWeights& weights) {
  return packed(weights.w, weights.b, weights.inputs, weights.outputs);
}

inline std::vector<float> packed_transposed(const EffectiveWeights& weights) {
  return packed(reference::transposed(weights.w, weights.inputs, weights.outputs),
                std::vector<double>(weights.inputs, 0.0), weights.outputs, weights.inputs);
}

}  // namespace arah
