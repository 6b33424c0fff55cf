// What the linear layer's kernels read and write, made and checked on the CPU.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "kernels/linear/matrix.h"
#include "kernels/reference/linear.h"

namespace arah {

// Effective weights in double precision: w [inputs][outputs], b [outputs], both padded.
struct EffectiveWeights {
  uint32_t inputs = 0;
  uint32_t outputs = 0;
  std::vector<double> w;
  std::vector<double> b;
};

// The packing that pack_weights documents: tiles of columns, in each first a row `first_row`, then the rows of the matrix.
inline std::vector<float> packed(const std::vector<double>& matrix, const std::vector<double>& first_row, uint32_t rows, uint32_t columns) {
  const uint32_t tile = columns % 16 == 0 ? 16 : 8;
  std::vector<float> result;
  for (uint32_t first = 0; first < columns; first += tile) {
    for (uint32_t c = 0; c < tile; ++c) result.push_back(static_cast<float>(first_row[first + c]));
    for (uint32_t r = 0; r < rows; ++r)
      for (uint32_t c = 0; c < tile; ++c) result.push_back(static_cast<float>(matrix[size_t(r) * columns + first + c]));
  }
  return result;
}

inline std::vector<float> packed_forward(const EffectiveWeights& weights) { return packed(weights.w, weights.b, weights.inputs, weights.outputs); }

inline std::vector<float> packed_transposed(const EffectiveWeights& weights) {
  return packed(reference::transposed(weights.w, weights.inputs, weights.outputs), std::vector<double>(weights.inputs, 0.0), weights.outputs, weights.inputs);
}

// Prints the largest difference and where it is; a NaN fails.
inline void expect_close(const std::string& what, const std::vector<double>& found, const std::vector<double>& truth, double tolerance) {
  ASSERT_EQ(found.size(), truth.size()) << what;
  double largest = 0;
  size_t where = 0;
  for (size_t i = 0; i < truth.size() && !std::isnan(largest); ++i) {
    const double error = std::abs(found[i] - truth[i]);
    if (!(error <= largest)) largest = error, where = i;
  }
  std::printf("  %-44s largest difference %.2e\n", what.c_str(), largest);
  EXPECT_LE(largest, tolerance) << what << " at " << where << ": " << found[where] << ", truth " << truth[where];
}

inline std::vector<double> as_doubles(const std::vector<float>& values) { return {values.begin(), values.end()}; }

}  // namespace arah
