// Activation functions with first and second derivatives, in double precision.
//
// The kinks follow the usual choice of automatic differentiation: the derivative of ReLU at 0 is 0 and of leaky ReLU
// its slope. Every form is finite at any finite argument.
#pragma once

#include <cmath>
#include <span>
#include <vector>

#include "kernels/reference/sizes.h"

namespace arah::reference {

enum class Activation {
  none,        // x
  relu,        // max(x, 0): colour network
  leaky_relu,  // x > 0 ? x : 0.2 x: mapping network
  softplus,    // log(1 + exp(100 x)) / 100, and x itself where 100 x > 20: skinning network (ARAH.md section 2)
  sine,        // sin(x); the frequency of a SIREN is the caller's
  sigmoid,     // 1 / (1 + exp(-x))
};

inline constexpr double kLeakySlope = 0.2;
inline constexpr double kSoftplusSharpness = 100;
inline constexpr double kSoftplusLinearAbove = 20;  // in units of sharpness * x

// 1 / (1 + exp(-x)) without overflow. 1 - sigmoid(x) is sigmoid(-x), without cancellation.
inline double sigmoid(double x) {
  if (x >= 0) return 1 / (1 + std::exp(-x));
  const double e = std::exp(x);
  return e / (1 + e);
}

inline double activate(Activation activation, double x) {
  switch (activation) {
    case Activation::none:
      return x;
    case Activation::relu:
      return x > 0 || std::isnan(x) ? x : 0;
    case Activation::leaky_relu:
      return x > 0 ? x : kLeakySlope * x;
    case Activation::softplus: {
      const double t = kSoftplusSharpness * x;
      return t > kSoftplusLinearAbove ? x : std::log1p(std::exp(t)) / kSoftplusSharpness;
    }
    case Activation::sine:
      return std::sin(x);
    case Activation::sigmoid:
      return sigmoid(x);
  }
  return std::nan("");
}

// d activate / dx.
inline double activate_derivative(Activation activation, double x) {
  switch (activation) {
    case Activation::none:
      return 1;
    case Activation::relu:
      return x > 0 ? 1 : 0;
    case Activation::leaky_relu:
      return x > 0 ? 1 : kLeakySlope;
    case Activation::softplus: {
      const double t = kSoftplusSharpness * x;
      return t > kSoftplusLinearAbove ? 1 : sigmoid(t);
    }
    case Activation::sine:
      return std::cos(x);
    case Activation::sigmoid:
      return sigmoid(x) * sigmoid(-x);
  }
  return std::nan("");
}

// d2 activate / dx2.
inline double activate_second_derivative(Activation activation, double x) {
  switch (activation) {
    case Activation::none:
    case Activation::relu:
    case Activation::leaky_relu:
      return 0;
    case Activation::softplus: {
      const double t = kSoftplusSharpness * x;
      return t > kSoftplusLinearAbove ? 0 : kSoftplusSharpness * sigmoid(t) * sigmoid(-t);
    }
    case Activation::sine:
      return -std::sin(x);
    case Activation::sigmoid:
      // s' (1 - 2 s), and 1 - 2 s = -tanh(x/2)
      return -sigmoid(x) * sigmoid(-x) * std::tanh(x / 2);
  }
  return std::nan("");
}

// dL/dx from dL/dy at the pre-activations x, element by element. Both spans have the same size.
inline std::vector<double> activation_gradient(Activation activation, std::span<const double> x,
                                               std::span<const double> d_y) {
  check_size("activation_gradient: d_y", d_y.size(), x.size());
  std::vector<double> d_x(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) d_x[i] = d_y[i] * activate_derivative(activation, x[i]);
  return d_x;
}

}  // namespace arah::reference
