// Rows of flat arrays as the reference's small vectors and matrices, and back.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "kernels/reference/small_matrix.h"

namespace arah::reference {

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

inline std::vector<Vector<3>> as_rows(const std::vector<double>& values) {
  std::vector<Vector<3>> rows;
  for (std::size_t i = 0; i < values.size() / 3; ++i) rows.push_back(row<3>(values, i));
  return rows;
}

inline std::vector<double> flat(const std::vector<Vector<3>>& rows) {
  std::vector<double> values;
  for (const Vector<3>& values_row : rows) append<3>(values, values_row);
  return values;
}

}  // namespace arah::reference
