// The tolerance of a float32 implementation against the golden tensors: how far the authors' own float32 run is from
// the float64 truth stands in the tables of the set's README.md ("f32-ref max abs err"), and is read from there.
#pragma once

#include <fstream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/golden.h"

namespace arah::golden {

// Tensor → largest error of the float32 reference, from the table of section "## <name>.safetensors"; tensors whose
// column is empty (inputs, parameters) are left out. Throws std::runtime_error where the section or its table is
// missing.
inline std::map<std::string, double> float_errors(const std::string& name) {
  std::ifstream readme(folder() / "README.md");
  std::map<std::string, double> errors;
  bool inside = false;
  for (std::string line; std::getline(readme, line);) {
    if (line.starts_with("## ")) inside = line.starts_with("## " + name + ".safetensors");
    if (!inside || !line.starts_with("|`")) continue;
    // |`tensor`|type|shape|meaning|max abs err|max err / max abs|rel. L2|; the meaning may hold bars, so count from the
    // end
    std::vector<size_t> bars;
    for (size_t at = line.find('|'); at != std::string::npos; at = line.find('|', at + 1)) bars.push_back(at);
    if (bars.size() < 8) throw std::runtime_error("golden README.md, " + name + ": expected 7 columns in: " + line);
    const size_t first = bars[bars.size() - 4] + 1, last = bars[bars.size() - 3];
    if (first == last) continue;
    errors[line.substr(2, line.find('`', 2) - 2)] = std::stod(line.substr(first, last - first));
  }
  if (errors.empty())
    throw std::runtime_error("golden README.md in " + folder().string() + " has no table for " + name);
  return errors;
}

// max(10 × the float32 reference's largest error, 2e-6 × the largest number), as the README.md suggests.
inline double float_limit(const Case& truth, const std::string& tensor) {
  static std::map<std::string, std::map<std::string, double>> tables;
  if (!tables.contains(truth.name())) tables[truth.name()] = float_errors(truth.name());
  double scale = 0;
  for (double value : truth.values(tensor)) scale = std::max(scale, std::abs(value));
  return std::max(10 * tables[truth.name()].at(tensor), 2e-6 * scale);
}

inline void expect_golden_float(const Case& truth, const std::string& tensor, std::span<const double> actual) {
  expect_close(truth.name() + " " + tensor, actual, truth.values(tensor), float_limit(truth, tensor));
}

}  // namespace arah::golden
