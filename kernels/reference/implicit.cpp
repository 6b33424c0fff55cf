#include "kernels/reference/implicit.h"

namespace arah::reference {

PointImplicitGradient implicit_point_gradient(const Matrix<3>& jacobian, const Vector<3>& upstream) {
  PointImplicitGradient gradient;
  const auto inverted = inverse<3>(jacobian);
  if (!inverted) {
    gradient.singular = true;
    return gradient;
  }
  gradient.posed = multiply_transposed<3>(*inverted, upstream);
  for (int i = 0; i < 3; ++i) gradient.skinned[i] = -gradient.posed[i];
  return gradient;
}

Matrix<3> jacobian_in_cube(const Matrix<3>& skinning_jacobian, double extent) {
  Matrix<3> jacobian = skinning_jacobian;
  for (auto& row : jacobian)
    for (double& value : row) value *= extent / 2;
  return jacobian;
}

JointImplicitGradient implicit_joint_gradient(const Matrix<4>& jacobian, const Vector<4>& upstream, double depth) {
  JointImplicitGradient gradient;
  const auto inverted = inverse<4>(jacobian);
  if (!inverted) {
    gradient.singular = true;
    return gradient;
  }
  const Vector<4> minus = multiply_transposed<4>(*inverted, upstream);
  gradient.sdf = -minus[0];
  for (int i = 0; i < 3; ++i) {
    gradient.skinned[i] = -minus[i + 1];
    gradient.camera[i] = minus[i + 1];
    gradient.direction[i] = depth * minus[i + 1];
    gradient.translation[i] = -minus[i + 1];
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
