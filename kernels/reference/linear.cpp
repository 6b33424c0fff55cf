#include "kernels/reference/linear.h"

#include <cmath>

#include "kernels/reference/sizes.h"

namespace arah::reference {

std::vector<double> linear_pre_activation(const LinearShape& shape, std::span<const double> x,
                                          std::span<const double> w, std::span<const double> b) {
  const auto [points, inputs, outputs] = shape;
  check_size("linear: x", x.size(), points * inputs);
  check_size("linear: w", w.size(), inputs * outputs);
  if (!b.empty()) check_size("linear: b", b.size(), outputs);
  std::vector<double> a(points * outputs, 0.0);
  for (std::size_t p = 0; p < points; ++p) {
    for (std::size_t i = 0; i < inputs; ++i) {
      const double value = x[p * inputs + i];
      for (std::size_t o = 0; o < outputs; ++o) a[p * outputs + o] += value * w[i * outputs + o];
    }
    if (b.empty()) continue;
    for (std::size_t o = 0; o < outputs; ++o) a[p * outputs + o] += b[o];
  }
  return a;
}

std::vector<double> linear_forward(const LinearShape& shape, std::span<const double> x, std::span<const double> w,
                                   std::span<const double> b, Activation activation) {
  std::vector<double> y = linear_pre_activation(shape, x, w, b);
  for (double& value : y) value = activate(activation, value);
  return y;
}

std::vector<double> linear_input_gradient(const LinearShape& shape, std::span<const double> d_a,
                                          std::span<const double> w) {
  const auto [points, inputs, outputs] = shape;
  check_size("linear input gradient: d_a", d_a.size(), points * outputs);
  check_size("linear input gradient: w", w.size(), inputs * outputs);
  std::vector<double> d_x(points * inputs, 0.0);
  for (std::size_t p = 0; p < points; ++p) {
    for (std::size_t i = 0; i < inputs; ++i) {
      double sum = 0;
      for (std::size_t o = 0; o < outputs; ++o) sum += d_a[p * outputs + o] * w[i * outputs + o];
      d_x[p * inputs + i] = sum;
    }
  }
  return d_x;
}

void linear_weight_gradient(const LinearShape& shape, std::span<const double> x, std::span<const double> d_a,
                            std::span<double> d_w, std::span<double> d_b) {
  const auto [points, inputs, outputs] = shape;
  check_size("linear weight gradient: x", x.size(), points * inputs);
  check_size("linear weight gradient: d_a", d_a.size(), points * outputs);
  check_size("linear weight gradient: d_w", d_w.size(), inputs * outputs);
  if (!d_b.empty()) check_size("linear weight gradient: d_b", d_b.size(), outputs);
  for (std::size_t p = 0; p < points; ++p) {
    for (std::size_t i = 0; i < inputs; ++i) {
      const double value = x[p * inputs + i];
      for (std::size_t o = 0; o < outputs; ++o) d_w[i * outputs + o] += value * d_a[p * outputs + o];
    }
    if (d_b.empty()) continue;
    for (std::size_t o = 0; o < outputs; ++o) d_b[o] += d_a[p * outputs + o];
  }
}

std::vector<double> transposed(std::span<const double> matrix, std::size_t rows, std::size_t columns) {
  check_size("transposed: matrix", matrix.size(), rows * columns);
  std::vector<double> result(matrix.size());
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) result[c * rows + r] = matrix[r * columns + c];
  }
  return result;
}

namespace {

// |v[:, o]| of every output.
std::vector<double> column_norms(std::size_t inputs, std::size_t outputs, std::span<const double> v) {
  std::vector<double> norms(outputs, 0.0);
  for (std::size_t i = 0; i < inputs; ++i) {
    for (std::size_t o = 0; o < outputs; ++o) norms[o] = std::hypot(norms[o], v[i * outputs + o]);
  }
  return norms;
}

}  // namespace

std::vector<double> weight_norm_forward(std::size_t inputs, std::size_t outputs, std::span<const double> v,
                                        std::span<const double> g) {
  check_size("weight norm: v", v.size(), inputs * outputs);
  check_size("weight norm: g", g.size(), outputs);
  const std::vector<double> norms = column_norms(inputs, outputs, v);
  std::vector<double> w(v.size(), 0.0);
  for (std::size_t i = 0; i < inputs; ++i) {
    for (std::size_t o = 0; o < outputs; ++o) {
      if (norms[o] != 0) w[i * outputs + o] = g[o] * (v[i * outputs + o] / norms[o]);
    }
  }
  return w;
}

void weight_norm_backward(std::size_t inputs, std::size_t outputs, std::span<const double> v, std::span<const double> g,
                          std::span<const double> d_w, std::span<double> d_v, std::span<double> d_g) {
  check_size("weight norm backward: v", v.size(), inputs * outputs);
  check_size("weight norm backward: g", g.size(), outputs);
  check_size("weight norm backward: d_w", d_w.size(), v.size());
  check_size("weight norm backward: d_v", d_v.size(), v.size());
  check_size("weight norm backward: d_g", d_g.size(), outputs);
  const std::vector<double> norms = column_norms(inputs, outputs, v);
  for (std::size_t o = 0; o < outputs; ++o) {
    if (norms[o] == 0) continue;
    double along = 0;  // dW . u
    for (std::size_t i = 0; i < inputs; ++i) along += d_w[i * outputs + o] * (v[i * outputs + o] / norms[o]);
    d_g[o] += along;
    for (std::size_t i = 0; i < inputs; ++i) {
      const std::size_t k = i * outputs + o;
      d_v[k] += g[o] / norms[o] * (d_w[k] - along * (v[k] / norms[o]));
    }
  }
}

}  // namespace arah::reference
