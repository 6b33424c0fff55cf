// Broyden's "good" method for the canonical point of a posed point (D = 3) and for the canonical point and depth of a
// ray's first surface point (D = 4): paper section "Joint Root-Finding", ARAH.md section 5.
#pragma once

#include "kernels/reference/small_matrix.h"

namespace arah::reference {

struct BroydenSettings {
  int max_iterations = 50;
  double tolerance = 1e-5;           // metres: converged where the best residual's norm is below
  double divergence = 1;             // metres: given up where the current residual's norm is not below
  double denominator_offset = 1e-6;  // added to the update's denominator, away from zero
};

template <int D>
struct BroydenResult {
  Vector<D> root{};        // the iterate with the smallest residual, the start included
  Matrix<4> transform{};   // blended transform T there; the given one where no step improved on the start
  double residual = 0;     // |g(root)|, metres
  int iterations = 0;      // steps taken = evaluations of g after the first
  bool converged = false;  // residual < tolerance
  bool diverged = false;   // not converged, and stopped by |g| >= divergence or a value that is not finite
};

// Searches a root of g from `start` with the approximate inverse Jacobian `inverse_jacobian` (H₀):
//   Δ = −H g;  u += Δ;  y = g(u) − g_old;  vᵀ = Δᵀ H;  H += ((Δ − H y) / (vᵀ y ± offset)) vᵀ,   sign(0) = +.
// The start is not tested, so at least one step is taken, with one exception: where the start, its residual or H₀ is
// not finite (H₀ of a singular Jacobian is NaN) there is no search and the result is diverged. No step is limited.
// `residual` is called as Vector<D> residual(const Vector<D>& u, Matrix<4>& transform) and writes T(u).
template <int D, class Residual>
BroydenResult<D> find_root(const Vector<D>& start, const Matrix<4>& start_transform, const Matrix<D>& inverse_jacobian,
                           Residual&& residual, const BroydenSettings& settings = {}) {
  BroydenResult<D> best;
  best.root = start;
  best.transform = start_transform;
  Matrix<4> transform = start_transform;
  Vector<D> u = start;
  Vector<D> g = residual(u, transform);
  double current = norm<D>(g);
  best.residual = current;
  Matrix<D> h = inverse_jacobian;
  if (!all_finite<D>(start) || !std::isfinite(current) || !all_finite<D>(h)) {
    best.diverged = true;
    return best;
  }

  bool active = settings.max_iterations > 0;
  Vector<D> step = multiply<D>(h, g);
  for (double& component : step) component = -component;
  while (active) {
    Vector<D> y = g;
    for (int i = 0; i < D; ++i) u[i] += step[i];
    g = residual(u, transform);
    for (int i = 0; i < D; ++i) y[i] = g[i] - y[i];
    current = norm<D>(g);
    ++best.iterations;
    if (current < best.residual) {
      best.root = u;
      best.transform = transform;
      best.residual = current;
    }
    active = best.residual > settings.tolerance && current < settings.divergence &&
             best.iterations < settings.max_iterations;
    if (!active) break;

    const Vector<D> v = multiply_transposed<D>(h, step);
    double denominator = dot<D>(v, y);
    denominator += denominator < 0 ? -settings.denominator_offset : settings.denominator_offset;
    const Vector<D> hy = multiply<D>(h, y);
    for (int i = 0; i < D; ++i)
      for (int j = 0; j < D; ++j) h[i][j] += (step[i] - hy[i]) / denominator * v[j];
    step = multiply<D>(h, g);
    for (double& component : step) component = -component;
  }
  best.converged = best.residual < settings.tolerance;
  best.diverged = !best.converged && !(current < settings.divergence);
  return best;
}

// H₀ of the point search: inverse of the upper 3x3 of the blended transform at the start, with the skinning network's
// own weights; the derivative of the weights is left out on purpose. NaN where that block is singular.
Matrix<3> point_inverse_jacobian(const Matrix<4>& blended_transform);

// ∂g/∂(x̂, d) of g = [f_metric(x̂); LBS(x̂) − (c + d·v − t)], metres: rows [∇f_metric, 0] and [∂LBS/∂x̂, −v].
Matrix<4> joint_jacobian(const Vector<3>& sdf_gradient, const Matrix<3>& skinning_jacobian, const Vector<3>& direction);

// H₀ of the joint search: the inverse of joint_jacobian, NaN where that is singular (a ray that grazes the surface).
Matrix<4> joint_inverse_jacobian(const Vector<3>& sdf_gradient, const Matrix<3>& skinning_jacobian,
                                 const Vector<3>& direction);

// The ray-surface intersection counts only inside the ray's interval (ARAH.md section 4); depth is u[3].
bool hits_surface(const BroydenResult<4>& result, double near, double far);

}  // namespace arah::reference
