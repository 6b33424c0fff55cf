// Central differences of a scalar function: what an analytic gradient is compared with.
#pragma once

#include <functional>
#include <span>
#include <vector>

namespace arah::reference {

// dvalue/dx by (value(x + h) − value(x − h)) / 2h, one component at a time; `value` reads x through its own reference,
// and x is restored. In double precision h near 1e-6 of the scale of x leaves a relative error of some 1e-9.
inline std::vector<double> numeric_gradient(std::span<double> x, const std::function<double()>& value,
                                            double h = 1e-6) {
  std::vector<double> gradient;
  for (double& component : x) {
    const double middle = component;
    component = middle + h;
    const double above = value();
    component = middle - h;
    const double below = value();
    component = middle;
    gradient.push_back((above - below) / (2 * h));
  }
  return gradient;
}

}  // namespace arah::reference
