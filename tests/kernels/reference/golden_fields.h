// The networks of the golden set as the reference's structures: the skinning network of 03_lbs_net and SIREN fields.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "kernels/reference/siren.h"
#include "kernels/reference/skinning.h"
#include "kernels/reference/small_matrix.h"
#include "tests/golden.h"

namespace arah::reference {

// [rows][columns] to [columns][rows]: the golden matrices are [out][in], the reference's [in][out].
inline std::vector<double> transposed(const std::vector<double>& matrix, std::size_t rows, std::size_t columns) {
  std::vector<double> result(matrix.size());
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t c = 0; c < columns; ++c) result[c * rows + r] = matrix[r * columns + c];
  return result;
}

inline SkinningNetwork golden_skinning_network(const golden::Case& lbs) {
  SkinningNetwork network{
      JointTree({-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21}), {}, {}, 20};
  const auto center = lbs.values("in.center");
  network.cube = {{center[0], center[1], center[2]}, lbs.scalar("in.cmin"), lbs.scalar("in.cmax")};
  for (int i = 0; i < 5; ++i) {
    const std::string name = "param.lbs." + std::to_string(i) + ".";
    DenseLayer layer;
    layer.outputs = lbs.extent(name + "v", 0);
    layer.inputs = lbs.extent(name + "v", 1);
    layer.activation = i < 4 ? Activation::softplus : Activation::none;
    layer.v = transposed(lbs.values(name + "v"), layer.outputs, layer.inputs);
    layer.g = lbs.values(name + "g");
    layer.b = lbs.values(name + "b");
    network.layers.layers.push_back(layer);
  }
  return network;
}

// Tensors param.sdf.<layer>.{W, b, gamma, eta}; γ = 1 and η = 0 where they are not stored or `plain` is set.
inline Siren golden_siren(const golden::Case& parameters, bool plain) {
  Siren siren;
  for (int i = 0; parameters.has("param.sdf." + std::to_string(i) + ".W"); ++i) {
    const std::string name = "param.sdf." + std::to_string(i) + ".";
    SirenLayer layer;
    layer.outputs = parameters.extent(name + "W", 0);
    layer.inputs = parameters.extent(name + "W", 1);
    layer.w = transposed(parameters.values(name + "W"), layer.outputs, layer.inputs);
    layer.b = parameters.values(name + "b");
    layer.gamma = plain ? std::vector<double>(layer.outputs, 1.0) : std::vector<double>();
    layer.eta = plain ? std::vector<double>(layer.outputs, 0.0) : std::vector<double>();
    if (!plain && parameters.has(name + "gamma")) {
      layer.gamma = parameters.values(name + "gamma");
      layer.eta = parameters.values(name + "eta");
    }
    siren.layers.push_back(layer);
  }
  siren.layers.back().gamma.clear();
  siren.layers.back().eta.clear();
  return siren;
}

template <int D>
Vector<D> row(const std::vector<double>& rows, std::size_t index) {
  Vector<D> result;
  std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(index * D), D, result.begin());
  return result;
}

template <int D>
Matrix<D> matrix(const std::vector<double>& matrices, std::size_t index = 0) {
  Matrix<D> result;
  for (int i = 0; i < D; ++i) result[i] = row<D>(matrices, index * D + i);
  return result;
}

template <int D>
void append(std::vector<double>& numbers, const Vector<D>& values) {
  numbers.insert(numbers.end(), values.begin(), values.end());
}

template <int D>
void append(std::vector<double>& numbers, const Matrix<D>& values) {
  for (const auto& values_row : values) append<D>(numbers, values_row);
}

}  // namespace arah::reference
