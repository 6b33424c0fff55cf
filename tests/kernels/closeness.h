// Comparison of what a kernel found with the double-precision truth.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace arah {

// Prints the largest difference; fails where it is above the tolerance or a NaN.
inline void expect_close(const std::string& what, const std::vector<double>& found, const std::vector<double>& truth,
                         double tolerance) {
  ASSERT_EQ(found.size(), truth.size()) << what;
  double largest = 0;
  size_t where = 0;
  for (size_t i = 0; i < truth.size() && !std::isnan(largest); ++i) {
    const double error = std::abs(found[i] - truth[i]);
    if (!(error <= largest)) {
      largest = error;
      where = i;
    }
  }
  std::printf("  %-44s largest difference %.2e\n", what.c_str(), largest);
  if (truth.empty()) return;
  EXPECT_LE(largest, tolerance) << what << " at " << where << ": " << found[where] << ", truth " << truth[where];
}

inline std::vector<double> as_doubles(const std::vector<float>& values) {
  return {values.begin(), values.end()};
}

}  // namespace arah
