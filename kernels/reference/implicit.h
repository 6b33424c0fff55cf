// Gradients through root finding by the implicit function theorem: paper appendix "Implicit Gradients", ARAH.md
// section 6. Roots and Jacobians are constants; only the residual carries derivatives, so that a root u* behaves as
// u = u* − J⁻¹ g(u*), and an upstream gradient dL/du becomes dL/dg = −J⁻ᵀ dL/du.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "kernels/reference/small_matrix.h"

namespace arah::reference {

// How much longer than the upstream gradient u the gradient g = −J⁻ᵀ u may be; a longer one keeps its direction and becomes
// most_amplification |u| long. It grows by as much as 1 / σ_min(J), without a bound as J becomes singular; and a root whose
// residual is below 1e-5 m is known to 1e-5 m / σ_min only, so that at 100 the linearisation is taken a millimetre beside the root, and
// beyond says nothing of it.
inline constexpr double most_amplification = 100;

// What the loss's gradient on a sample's canonical point means for the skinning and for the posed point.
struct PointImplicitGradient {
  Vector<3> skinned{};    // dL/dLBS(x̂*): upstream of the skinning's backward pass at the fixed point x̂*
  Vector<3> posed{};      // dL/dx̄ of the searched-for posed point (translation excluded); = −skinned
  bool singular = false;  // J has no inverse: both gradients are zero, the sample teaches the skinning nothing
  bool shortened = false;
};

// `jacobian`: ∂LBS/∂x̂ at the root, row = posed component, in metres per unit of the canonical coordinates that
// `upstream` = dL/dx̂ is taken in: metres, or cube coordinates n with ∂LBS/∂n = ∂LBS/∂x̂ · 1.1 r / 2.
PointImplicitGradient implicit_point_gradient(const Matrix<3>& jacobian, const Vector<3>& upstream);

// ∂LBS/∂n from ∂LBS/∂x̂: `extent` is 1.1 (cmax − cmin), metres, the cube's edge (ARAH.md section 1).
Matrix<3> jacobian_in_cube(const Matrix<3>& skinning_jacobian, double extent);

// What the loss says about the pose. The root of LBS(x̂; B) = x̄ − t moves as its bone transforms and the root translation do;
// x̄ is where the ray was sampled, and stays. With g = dL/dLBS(x̂*) of each root:
//   dL/dB_b = Σ_points g (w_b(x̂*) [x̂*; 1])ᵀ,   dL/dt = Σ_points g.
struct PoseImplicitGradient {
  std::vector<double> bone_transforms;  // [joints][3][4]
  Vector<3> root_translation{};
};

// weights [points][joints], x [points][3] the roots, skinned [points][3] their PointImplicitGradient::skinned. Throws
// std::invalid_argument when sizes do not fit.
PoseImplicitGradient implicit_pose_gradient(std::size_t joints, std::span<const double> weights, std::span<const double> x,
                                            std::span<const double> skinned);

// Likewise for the joint root u = (x̂, d) of g = [f_metric(x̂); LBS(x̂) − (c + d·v − t)].
struct JointImplicitGradient {
  double sdf = 0;           // dL/df_metric(x̂*)
  Vector<3> skinned{};      // dL/dLBS(x̂*)
  Vector<3> camera{};       // dL/dc
  Vector<3> direction{};    // dL/dv, with v free (not held to unit length)
  Vector<3> translation{};  // dL/dt
  bool singular = false;    // all gradients zero
  bool shortened = false;
};

// `jacobian`: joint_jacobian at the root (kernels/reference/broyden.h); `upstream` = dL/d(x̂, d), x̂ in metres;
// `depth` = d*, metres.
JointImplicitGradient implicit_joint_gradient(const Matrix<4>& jacobian, const Vector<4>& upstream, double depth);

// The value the paper's formula gives: u* − J⁻¹ g(u*), one Newton step. u* itself where J is singular.
Vector<4> newton_corrected(const Vector<4>& root, const Matrix<4>& jacobian, const Vector<4>& residual);

}  // namespace arah::reference
