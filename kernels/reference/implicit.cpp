#include "kernels/reference/implicit.h"

#include "kernels/reference/sizes.h"

namespace arah::reference {
namespace {

// −J⁻ᵀ u, bounded; shortened: whether by that.
template <int D>
Vector<D> bounded_gradient(const Matrix<D>& inverted, const Vector<D>& upstream, bool& shortened) {
  Vector<D> g = multiply_transposed<D>(inverted, upstream);
  const double size = norm<D>(g), most = most_amplification * norm<D>(upstream);
  shortened = size > most;
  const double factor = shortened ? -most / size : -1;
  for (double& value : g) value *= factor;
  return g;
}

}  // namespace

PointImplicitGradient implicit_point_gradient(const Matrix<3>& jacobian, const Vector<3>& upstream) {
  PointImplicitGradient gradient;
  const auto inverted = inverse<3>(jacobian);
  if (!inverted) {
    gradient.singular = true;
    return gradient;
  }
  gradient.skinned = bounded_gradient<3>(*inverted, upstream, gradient.shortened);
  for (int i = 0; i < 3; ++i) gradient.posed[i] = -gradient.skinned[i];
  return gradient;
}

Matrix<3> jacobian_in_cube(const Matrix<3>& skinning_jacobian, double extent) {
  Matrix<3> jacobian = skinning_jacobian;
  for (auto& row : jacobian)
    for (double& value : row) value *= extent / 2;
  return jacobian;
}

PoseImplicitGradient implicit_pose_gradient(std::size_t joints, std::span<const double> weights, std::span<const double> x,
                                            std::span<const double> skinned) {
  const std::size_t points = x.size() / 3;
  check_size("pose gradient: x", x.size(), points * 3);
  check_size("pose gradient: weights", weights.size(), points * joints);
  check_size("pose gradient: skinned", skinned.size(), points * 3);
  PoseImplicitGradient gradient{std::vector<double>(joints * 12, 0.0), {}};
  for (std::size_t p = 0; p < points; ++p) {
    for (std::size_t i = 0; i < 3; ++i) {
      const double g = skinned[3 * p + i];
      gradient.root_translation[i] += g;
      for (std::size_t b = 0; b < joints; ++b) {
        double* row = &gradient.bone_transforms[12 * b + 4 * i];
        for (std::size_t k = 0; k < 3; ++k) row[k] += g * weights[p * joints + b] * x[3 * p + k];
        row[3] += g * weights[p * joints + b];
      }
    }
  }
  return gradient;
}

JointImplicitGradient implicit_joint_gradient(const Matrix<4>& jacobian, const Vector<4>& upstream, double depth) {
  JointImplicitGradient gradient;
  const auto inverted = inverse<4>(jacobian);
  if (!inverted) {
    gradient.singular = true;
    return gradient;
  }
  const Vector<4> g = bounded_gradient<4>(*inverted, upstream, gradient.shortened);
  gradient.sdf = g[0];
  for (int i = 0; i < 3; ++i) {
    gradient.skinned[i] = gradient.translation[i] = g[i + 1];
    gradient.camera[i] = -g[i + 1];
    gradient.direction[i] = -depth * g[i + 1];
  }
  return gradient;
}

Vector<4> newton_corrected(const Vector<4>& root, const Matrix<4>& jacobian, const Vector<4>& residual) {
  const auto inverted = inverse<4>(jacobian);
  if (!inverted) return root;
  const Vector<4> step = multiply<4>(*inverted, residual);
  Vector<4> corrected = root;
  for (int i = 0; i < 4; ++i) corrected[i] -= step[i];
  return corrected;
}

}  // namespace arah::reference
