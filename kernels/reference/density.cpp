#include "kernels/reference/density.h"

#include <algorithm>
#include <cmath>

namespace arah::reference {

double laplace_scale(double parameter) {
  return std::clamp(std::abs(parameter), kMinLaplaceScale, kMaxLaplaceScale);
}

double laplace_scale_derivative(double parameter) {
  const double size = std::abs(parameter);
  if (!(size >= kMinLaplaceScale && size <= kMaxLaplaceScale)) return 0;
  return parameter < 0 ? -1 : 1;
}

Density laplace_density(double sdf, double b) {
  const double u = std::abs(sdf) / b;
  const double tail = 0.5 * std::exp(-u) / b;
  Density density;
  density.value = sdf > 0 ? tail : (1 / b - tail);
  if (sdf == 0) density.value = 0.5 / b;
  density.d_sdf = sdf == 0 ? 0 : -tail / b;
  // Outside σ = tail, so ∂σ/∂b = tail (u − 1)/b; inside σ = 1/b − tail. An underflowed tail times an infinite u would
  // be NaN, hence the product only while the tail is there.
  const double d_tail = tail > 0 ? tail * (u - 1) / b : 0;
  density.d_b = sdf > 0 ? d_tail : -1 / (b * b) - d_tail;
  return density;
}

Density softplus_density(double s, double b) {
  const double u = -s / b, tail = std::exp(-std::abs(u));
  const double sigmoid = (u >= 0 ? 1 : tail) / (1 + tail), softplus = std::max(u, 0.0) + std::log1p(tail);
  Density density;
  density.value = softplus / b;
  density.d_sdf = -sigmoid / b / b;
  // An underflowed sigmoid times an infinite u would be NaN.
  density.d_b = -(softplus + (sigmoid > 0 ? u * sigmoid : 0)) / b / b;
  return density;
}

}  // namespace arah::reference
