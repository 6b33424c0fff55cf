// Derivatives by finite differences, for checking written ones.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <span>
#include <string>
#include <vector>

namespace arah::reference {

// Numbers in [-scale, scale), the same for the same seed.
inline std::vector<double> random_values(std::size_t count, double scale, unsigned seed) {
  std::mt19937_64 engine(seed);
  std::uniform_real_distribution<double> uniform(-scale, scale);
  std::vector<double> values(count);
  for (double& value : values) value = uniform(engine);
  return values;
}

inline double dot(std::span<const double> a, std::span<const double> b) {
  EXPECT_EQ(a.size(), b.size());
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

// Compares `gradient` with the five-point central difference of `loss` as each number of `parameter` moves; `loss`
// reads the parameter where it stands. The limit is relative to the largest gradient of the tensor.
inline void expect_gradient(const std::string& label, const std::function<double()>& loss, std::span<double> parameter,
                            std::span<const double> gradient, double step = 1e-4, double relative_limit = 1e-8) {
  ASSERT_EQ(parameter.size(), gradient.size()) << label;
  double scale = 0, largest = 0;
  std::size_t where = 0;
  double found = 0;
  for (std::size_t i = 0; i < parameter.size(); ++i) {
    const double original = parameter[i];
    const auto at = [&](double offset) {
      parameter[i] = original + offset;
      return loss();
    };
    const double numeric = (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step);
    parameter[i] = original;
    scale = std::max(scale, std::abs(numeric));
    const double error = std::abs(numeric - gradient[i]);
    if (!(error <= largest)) {
      largest = error;
      where = i;
      found = numeric;
    }
  }
  std::printf("  %-32s largest difference %.2e of %.3g\n", label.c_str(), largest, scale);
  EXPECT_GT(scale, 0) << label << ": the loss does not depend on it, so nothing was tested";
  EXPECT_LE(largest, relative_limit * scale)
      << label << " at " << where << ": " << gradient[where] << ", finite differences give " << found;
}

}  // namespace arah::reference
