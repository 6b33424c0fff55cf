// Golden tensors: finding them, loading a case, comparing with it. The folder is $ARAH_GOLDEN or ../shared/golden/open
// beside the source tree; its README.md states every formula and tolerance.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/avatar/safetensors.h"

namespace arah::golden {

inline std::filesystem::path folder() {
  if (const char* chosen = std::getenv("ARAH_GOLDEN")) return chosen;
  return std::filesystem::path(ARAH_SOURCE_DIR) / ".." / "shared" / "golden" / "open";
}

// First statement of a test that needs the golden tensors.
#define ARAH_SKIP_WITHOUT_GOLDEN()                            \
  if (!std::filesystem::is_directory(arah::golden::folder())) \
  GTEST_SKIP() << "no golden tensors at " << arah::golden::folder() << "; set ARAH_GOLDEN to their folder"

// One file of the set, e.g. Case("02_hsoftmax").
class Case {
 public:
  explicit Case(const std::string& name) : name_(name), file_(read_safetensors(folder() / (name + ".safetensors"))) {}

  const std::string& name() const { return name_; }
  const SafetensorsFile& file() const { return file_; }
  bool has(const std::string& tensor) const { return file_.tensors.contains(tensor); }
  const Tensor& tensor(const std::string& tensor) const { return file_.at(tensor); }
  const std::vector<int64_t>& shape(const std::string& tensor) const { return file_.at(tensor).shape; }
  int64_t extent(const std::string& tensor, size_t axis) const { return file_.at(tensor).shape.at(axis); }

  std::vector<double> values(const std::string& tensor) const { return file_.at(tensor).as<double>(); }
  double scalar(const std::string& tensor) const { return values(tensor).at(0); }
  std::vector<int32_t> integers(const std::string& tensor) const { return file_.at(tensor).as<int32_t>(); }

 private:
  std::string name_;
  SafetensorsFile file_;
};

// Every |actual - expected| must be at most `limit` (absolute); NaN fails. Prints the largest error either way.
inline void expect_close(const std::string& label, std::span<const double> actual, std::span<const double> expected,
                         double limit) {
  ASSERT_EQ(actual.size(), expected.size()) << label;
  double largest = 0, scale = 0;
  size_t where = 0;
  for (size_t i = 0; i < actual.size(); ++i) {
    scale = std::max(scale, std::abs(expected[i]));
    const double error = std::abs(actual[i] - expected[i]);
    if (!(error <= largest)) {
      largest = error;
      where = i;
      if (std::isnan(error)) break;
    }
  }
  std::printf("  %-32s largest error %.2e of %.3g (limit %.1e)\n", label.c_str(), largest, scale, limit);
  if (actual.empty()) return;
  EXPECT_LE(largest, limit) << label << " at " << where << ": " << actual[where] << " instead of " << expected[where];
}

// The limit for a double-precision implementation, relative to the largest number of the tensor: 1e-10 where it is
// stored in double precision, 1e-7 (its own rounding) where it is stored in single precision.
inline double double_limit(const Case& truth, const std::string& tensor) {
  double scale = 0;
  for (double value : truth.values(tensor)) scale = std::max(scale, std::abs(value));
  return scale * (truth.tensor(tensor).dtype == "F64" ? 1e-10 : 1e-7);
}

inline void expect_golden(const Case& truth, const std::string& tensor, std::span<const double> actual) {
  expect_close(truth.name() + " " + tensor, actual, truth.values(tensor), double_limit(truth, tensor));
}
inline void expect_golden(const Case& truth, const std::string& tensor, double actual) {
  expect_golden(truth, tensor, std::span<const double>(&actual, 1));
}

}  // namespace arah::golden
