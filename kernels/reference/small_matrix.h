// Vectors and square matrices of a few doubles: what root finding and its implicit gradients compute with.
// Matrices are arrays of rows; vectors are columns (DESIGN.md, conventions).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace arah::reference {

template <int D>
using Vector = std::array<double, D>;
template <int D>
using Matrix = std::array<std::array<double, D>, D>;

template <int D>
double dot(const Vector<D>& a, const Vector<D>& b) {
  double sum = 0;
  for (int i = 0; i < D; ++i) sum += a[i] * b[i];
  return sum;
}

template <int D>
double norm(const Vector<D>& a) {
  return std::sqrt(dot<D>(a, a));
}

template <int D>
bool all_finite(const Vector<D>& a) {
  for (double value : a)
    if (!std::isfinite(value)) return false;
  return true;
}

template <int D>
bool all_finite(const Matrix<D>& m) {
  for (const auto& row : m)
    if (!all_finite<D>(row)) return false;
  return true;
}

// m a
template <int D>
Vector<D> multiply(const Matrix<D>& m, const Vector<D>& a) {
  Vector<D> result;
  for (int i = 0; i < D; ++i) result[i] = dot<D>(m[i], a);
  return result;
}

// mᵀ a
template <int D>
Vector<D> multiply_transposed(const Matrix<D>& m, const Vector<D>& a) {
  Vector<D> result{};
  for (int i = 0; i < D; ++i)
    for (int j = 0; j < D; ++j) result[j] += m[i][j] * a[i];
  return result;
}

template <int D>
Matrix<D> identity() {
  Matrix<D> m{};
  for (int i = 0; i < D; ++i) m[i][i] = 1;
  return m;
}

// The matrix that stands for "there is no inverse": every result computed with it is NaN, so it cannot pass for a root.
template <int D>
Matrix<D> not_a_matrix() {
  Matrix<D> m;
  for (auto& row : m) row.fill(std::numeric_limits<double>::quiet_NaN());
  return m;
}

// Gauss–Jordan elimination with row pivoting. Nothing where a pivot is not above D·2⁻⁵²·max|m| (rank below D in
// double precision) or an entry is not finite.
template <int D>
std::optional<Matrix<D>> inverse(const Matrix<D>& m) {
  if (!all_finite<D>(m)) return std::nullopt;
  double largest = 0;
  for (const auto& row : m)
    for (double value : row) largest = std::max(largest, std::abs(value));
  const double threshold = D * std::numeric_limits<double>::epsilon() * largest;
  Matrix<D> a = m, b = identity<D>();
  for (int column = 0; column < D; ++column) {
    int pivot = column;
    for (int row = column + 1; row < D; ++row)
      if (std::abs(a[row][column]) > std::abs(a[pivot][column])) pivot = row;
    if (!(std::abs(a[pivot][column]) > threshold)) return std::nullopt;
    std::swap(a[pivot], a[column]);
    std::swap(b[pivot], b[column]);
    const double scale = 1 / a[column][column];
    for (int j = 0; j < D; ++j) a[column][j] *= scale, b[column][j] *= scale;
    for (int row = 0; row < D; ++row) {
      if (row == column) continue;
      const double factor = a[row][column];
      for (int j = 0; j < D; ++j) {
        a[row][j] -= factor * a[column][j];
        b[row][j] -= factor * b[column][j];
      }
    }
  }
  return b;
}

// Rotation part and translation of an affine 4x4: (T [x; 1])_xyz.
inline Vector<3> transform_point(const Matrix<4>& t, const Vector<3>& x) {
  Vector<3> result;
  for (int i = 0; i < 3; ++i) result[i] = t[i][0] * x[0] + t[i][1] * x[1] + t[i][2] * x[2] + t[i][3];
  return result;
}

inline Matrix<3> upper_3x3(const Matrix<4>& t) {
  Matrix<3> result;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) result[i][j] = t[i][j];
  return result;
}

}  // namespace arah::reference
