#include "kernels/reference/broyden.h"

namespace arah::reference {

Matrix<3> point_inverse_jacobian(const Matrix<4>& blended_transform) {
  return inverse<3>(upper_3x3(blended_transform)).value_or(not_a_matrix<3>());
}

Matrix<4> joint_jacobian(const Vector<3>& sdf_gradient, const Matrix<3>& skinning_jacobian,
                         const Vector<3>& direction) {
  Matrix<4> jacobian;
  jacobian[0] = {sdf_gradient[0], sdf_gradient[1], sdf_gradient[2], 0};
  for (int i = 0; i < 3; ++i)
    jacobian[i + 1] = {skinning_jacobian[i][0], skinning_jacobian[i][1], skinning_jacobian[i][2], -direction[i]};
  return jacobian;
}

Matrix<4> joint_inverse_jacobian(const Vector<3>& sdf_gradient, const Matrix<3>& skinning_jacobian,
                                 const Vector<3>& direction) {
  return inverse<4>(joint_jacobian(sdf_gradient, skinning_jacobian, direction)).value_or(not_a_matrix<4>());
}

bool hits_surface(const BroydenResult<4>& result, double near, double far) {
  return result.converged && near <= result.root[3] && result.root[3] <= far;
}

}  // namespace arah::reference
