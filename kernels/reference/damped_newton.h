// Newton's method with Levenberg's damping, for canonical points that Broyden's method did not find: it uses the exact
// Jacobian, takes no step that makes the residual larger, and stands Jacobians without an inverse.
#pragma once

#include "kernels/reference/small_matrix.h"

namespace arah::reference {

struct DampedNewtonSettings {
  int max_iterations = 20;  // evaluations after the start's
  double tolerance = 1e-5;  // metres: found where the residual's norm is below
};

struct DampedNewtonResult {
  Vector<3> root{};      // the iterate with the smallest residual
  double residual = 0;   // its norm, metres
  int evaluations = 0;   // the start's included
  bool found = false;
};

// The damping μ is relative to JᵀJ, whose entries are near 1 where bones turn and do not stretch. It falls by 8 after a step that was an
// improvement and rises by 8 after one that was none.
inline constexpr double first_damping = 1e-3, least_damping = 1e-7, greatest_damping = 1e6, damping_factor = 8;

// From x on: x ← x − (JᵀJ + μ)⁻¹ Jᵀ g, kept where |g| falls. evaluate(x, g, J) gives g(x), metres, and J = ∂g/∂x. Ends where
// |g| < tolerance, after max_iterations, or where μ passes greatest_damping: there is no way down. A value that is not finite is no improvement;
// a start that has one ends the search.
template <class Evaluate>
DampedNewtonResult find_root_damped(const Vector<3>& start, Evaluate&& evaluate, const DampedNewtonSettings& settings = {}) {
  DampedNewtonResult best{start, std::numeric_limits<double>::infinity(), 0, false};
  Vector<3> trial = start, g_best{};
  Matrix<3> j_best{};
  double damping = first_damping * damping_factor;
  for (int i = 0; i <= settings.max_iterations; ++i) {
    Vector<3> g{};
    Matrix<3> j{};
    evaluate(trial, g, j);
    ++best.evaluations;
    const double size = norm<3>(g);
    if (std::isfinite(size) && all_finite<3>(j) && size < best.residual) {
      best.root = trial;
      best.residual = size;
      g_best = g;
      j_best = j;
      damping = std::max(damping / damping_factor, least_damping);
    } else {
      damping *= damping_factor;
    }
    best.found = best.residual < settings.tolerance;
    if (best.found || !std::isfinite(best.residual) || damping > greatest_damping) break;

    Matrix<3> normal{};
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) {
        for (int k = 0; k < 3; ++k) normal[a][b] += j_best[k][a] * j_best[k][b];
        if (a == b) normal[a][b] += damping;
      }
    const Vector<3> step = multiply<3>(inverse<3>(normal).value_or(not_a_matrix<3>()), multiply_transposed<3>(j_best, g_best));
    for (int k = 0; k < 3; ++k) trial[k] = best.root[k] - step[k];
  }
  return best;
}

}  // namespace arah::reference
