#include "host/body/kinematics_gradient.h"

#include <fmt/format.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <stdexcept>

namespace arah {
namespace {

glm::dmat3 cross_matrix(const glm::dvec3& v) {
  return {0.0, v.z, -v.y, -v.z, 0.0, v.x, v.y, -v.x, 0.0};
}

// Sum of products of all entries.
double inner(const glm::dmat3& a, const glm::dmat3& b) {
  return glm::dot(a[0], b[0]) + glm::dot(a[1], b[1]) + glm::dot(a[2], b[2]);
}

// The joint at which the canonical turn of bone b begins: its highest ancestor that turns as it does. −1: none.
int turn_center(const Skeleton& skeleton, const CanonicalPose& canonical, std::size_t b) {
  if (canonical.rest_to_canonical[b] == glm::dmat4(1.0)) return -1;
  std::size_t at = b;
  while (skeleton.parents[at] >= 0) {
    const std::size_t parent = static_cast<std::size_t>(skeleton.parents[at]);
    if (canonical.rest_to_canonical[parent] != canonical.rest_to_canonical[b]) break;
    at = parent;
  }
  return static_cast<int>(at);
}

}  // namespace

glm::dvec3 axis_angle_gradient(const glm::dvec3& axis_angle, const glm::dmat3& rotation_gradient) {
  const double t2 = glm::dot(axis_angle, axis_angle);
  const double t = std::sqrt(t2);
  double a, b, a_slope, b_slope;  // a, b and their derivatives over t
  if (t < 0.1) {
    a = 1.0 + t2 * (-1.0 / 6 + t2 * (1.0 / 120 + t2 * (-1.0 / 5040 + t2 / 362880)));
    b = 1.0 / 2 + t2 * (-1.0 / 24 + t2 * (1.0 / 720 + t2 * (-1.0 / 40320 + t2 / 3628800)));
    a_slope = -1.0 / 3 + t2 * (1.0 / 30 + t2 * (-1.0 / 840 + t2 / 45360));
    b_slope = -1.0 / 12 + t2 * (1.0 / 180 + t2 * (-1.0 / 6720 + t2 / 453600));
  } else {
    const double half_sine = std::sin(0.5 * t);
    a = std::sin(t) / t;
    b = 2.0 * half_sine * half_sine / t2;
    a_slope = (std::cos(t) - a) / t2;
    b_slope = (a - 2.0 * b) / t2;
  }
  const glm::dmat3 cross = cross_matrix(axis_angle);
  const double along = a_slope * inner(rotation_gradient, cross) + b_slope * inner(rotation_gradient, cross * cross);
  glm::dvec3 gradient;
  for (int i = 0; i < 3; ++i) {
    glm::dvec3 axis(0.0);
    axis[i] = 1.0;
    const glm::dmat3 generator = cross_matrix(axis);
    gradient[i] = a * inner(rotation_gradient, generator) +
                  b * inner(rotation_gradient, generator * cross + cross * generator) + axis_angle[i] * along;
  }
  return gradient;
}

KinematicsGradient kinematics_gradient(const Skeleton& skeleton, const CanonicalPose& canonical, const Pose& pose,
                                       std::span<const glm::dmat4> bone_transform_gradients,
                                       std::span<const glm::dvec3> posed_joint_gradients, bool canonical_stays) {
  const std::size_t count = skeleton.size();
  if (bone_transform_gradients.size() != count || canonical.rest_to_canonical.size() != count ||
      (!posed_joint_gradients.empty() && posed_joint_gradients.size() != count)) {
    throw std::invalid_argument(fmt::format("gradients of {} bones and {} joints for a skeleton of {}",
                                            bone_transform_gradients.size(), posed_joint_gradients.size(), count));
  }
  const std::vector<glm::dmat4> frames = forward_kinematics(skeleton, pose);
  KinematicsGradient result{std::vector<glm::dvec3>(count, glm::dvec3(0.0)),
                            std::vector<glm::dvec3>(count, glm::dvec3(0.0))};
  // dL/dG_j, split into rotation and translation.
  std::vector<glm::dmat3> frame_rotation(count, glm::dmat3(0.0));
  std::vector<glm::dvec3> frame_translation(count, glm::dvec3(0.0));

  for (std::size_t b = 0; b < count; ++b) {
    const glm::dvec3& joint = skeleton.rest_joints[b];
    const glm::dmat3 linear_gradient(bone_transform_gradients[b]);
    const glm::dvec3 offset_gradient(bone_transform_gradients[b][3]);
    const glm::dmat3 rotation(frames[b]);
    // B = A V⁻¹ with V⁻¹ = [Rᵀ | u], u = c − Rᵀ c, c the turn's centre; so B's translation is A_R u + A_t.
    const glm::dmat3 turn(canonical.rest_to_canonical[b]);
    const glm::dvec3 u = -(glm::transpose(turn) * glm::dvec3(canonical.rest_to_canonical[b][3]));
    const glm::dmat3 a_linear = linear_gradient * turn + glm::outerProduct(offset_gradient, u);
    const int center = canonical_stays ? -1 : turn_center(skeleton, canonical, b);
    if (center >= 0) {
      const glm::dvec3 u_gradient = glm::transpose(rotation) * offset_gradient;
      result.rest_joints[static_cast<std::size_t>(center)] += u_gradient - turn * u_gradient;
    }
    // A = G T(−J): A_R = G_R, A_t = G_t − G_R J.
    frame_rotation[b] += a_linear - glm::outerProduct(offset_gradient, joint);
    frame_translation[b] += offset_gradient;
    result.rest_joints[b] -= glm::transpose(rotation) * offset_gradient;
    if (!posed_joint_gradients.empty()) frame_translation[b] += posed_joint_gradients[b];
  }

  // Children come after parents: going back, each dL/dG_j is complete when it is passed on.
  for (std::size_t j = count; j-- > 0;) {
    glm::dmat3 rotation_gradient = frame_rotation[j];
    glm::dvec3 offset_gradient = frame_translation[j];
    if (skeleton.parents[j] >= 0) {
      const std::size_t parent = static_cast<std::size_t>(skeleton.parents[j]);
      const glm::dmat3 parent_transposed = glm::transpose(glm::dmat3(frames[parent]));
      const glm::dvec3 offset = skeleton.rest_joints[j] - skeleton.rest_joints[parent];
      frame_rotation[parent] += frame_rotation[j] * glm::transpose(rotation_from_axis_angle(pose.theta[j])) +
                                glm::outerProduct(frame_translation[j], offset);
      frame_translation[parent] += frame_translation[j];
      rotation_gradient = parent_transposed * rotation_gradient;
      offset_gradient = parent_transposed * offset_gradient;
      result.rest_joints[parent] -= offset_gradient;
    }
    result.rest_joints[j] += offset_gradient;
    result.theta[j] = axis_angle_gradient(pose.theta[j], rotation_gradient);
  }
  return result;
}

}  // namespace arah
