// Rodrigues' formula and its derivative in long double: the truth that double precision is measured by.
#pragma once

#include <array>
#include <cmath>
#include <glm/vec3.hpp>

namespace arah {

using Exact3x3 = std::array<std::array<long double, 3>, 3>;  // rows

// R = I + a K + b K², a = sin t / t, b = (1 − cos t) / t², by series below t = 0.05; `along`: their derivatives over t.
struct ExactFactors {
  long double a, b, a_along, b_along;
};
inline ExactFactors exact_factors(long double t) {
  const long double s = t * t;
  if (t < 0.05L)
    return {1 - s / 6 * (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110)))), 0.5L - s / 24 * (1 - s / 30 * (1 - s / 56 * (1 - s / 90 * (1 - s / 132)))),
            -1 / 3.0L + s / 30 * (1 - s / 28 * (1 - s / 54 * (1 - s / 88))), -1 / 12.0L + s / 180 * (1 - 3 * s / 112 * (1 - 4 * s / 270 * (1 - 5 * s / 528)))};
  const long double half = std::sin(t / 2), a = std::sin(t) / t, b = 2 * half * half / s;
  return {a, b, (std::cos(t) - a) / s, (a - 2 * b) / s};
}

inline std::array<long double, 3> exact_cross(const std::array<long double, 3>& a, const std::array<long double, 3>& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline long double exact_dot(const std::array<long double, 3>& a, const std::array<long double, 3>& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

inline Exact3x3 exact_rotation(const glm::dvec3& theta) {
  const std::array<long double, 3> v{theta.x, theta.y, theta.z};
  const ExactFactors f = exact_factors(std::sqrt(exact_dot(v, v)));
  Exact3x3 rotation{};
  for (size_t c = 0; c < 3; ++c) {
    std::array<long double, 3> e{};
    e[c] = 1;
    const auto once = exact_cross(v, e), twice = exact_cross(v, once);
    for (size_t r = 0; r < 3; ++r) rotation[r][c] = e[r] + f.a * once[r] + f.b * twice[r];
  }
  return rotation;
}

// d (gᵀ R(θ) x) / dθ.
inline std::array<long double, 3> exact_slope(const glm::dvec3& theta, const glm::dvec3& force, const glm::dvec3& arm) {
  const std::array<long double, 3> v{theta.x, theta.y, theta.z}, g{force.x, force.y, force.z}, x{arm.x, arm.y, arm.z};
  const ExactFactors f = exact_factors(std::sqrt(exact_dot(v, v)));
  const auto kx = exact_cross(v, x), kkx = exact_cross(v, kx);
  const long double along = f.a_along * exact_dot(g, kx) + f.b_along * exact_dot(g, kkx);
  std::array<long double, 3> slope{};
  for (size_t i = 0; i < 3; ++i) {
    std::array<long double, 3> e{};
    e[i] = 1;
    const auto ex = exact_cross(e, x), ekx = exact_cross(e, kx), kex = exact_cross(v, ex);
    slope[i] = f.a * exact_dot(g, ex) + f.b * (exact_dot(g, ekx) + exact_dot(g, kex)) + v[i] * along;
  }
  return slope;
}

}  // namespace arah
