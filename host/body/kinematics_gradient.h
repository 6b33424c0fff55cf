// The way back through forward kinematics: from gradients of bone transforms to gradients of pose and rest joints.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "host/body/canonical.h"
#include "host/body/pose.h"
#include "host/body/skeleton.h"

namespace arah {

struct KinematicsGradient {
  std::vector<glm::dvec3> theta;        // dL/dθ_j, [J]
  std::vector<glm::dvec3> rest_joints;  // dL/dJ_j, [J]
};

// dL/d(axis-angle) from dL/dR at the rotation of `axis_angle`. With R = I + a K + b K²:
// ∂R/∂v_i = a E_i + b (E_i K + K E_i) + v_i (a'/t K + b'/t K²), E_i the generator of axis i; series below t = 0.1.
glm::dvec3 axis_angle_gradient(const glm::dvec3& axis_angle, const glm::dmat3& rotation_gradient);

// From dL/dB_b (of bone_transforms(); last rows are ignored, [J]) and, unless empty, dL/d(posed joint) (the
// translations of forward_kinematics(), [J]). J enters through A_b, the posed joints and the canonical turn's centre,
// the hip; the turn's angle counts as constant. canonical_stays: J does not enter through the turn, as where a body's shape
// changes while the canonical pose stays the one that its fields live in. The root translation is not part of B_b: its gradient is that of the
// posed points themselves. Throws std::invalid_argument if the numbers of joints differ.
KinematicsGradient kinematics_gradient(const Skeleton& skeleton, const CanonicalPose& canonical, const Pose& pose,
                                       std::span<const glm::dmat4> bone_transform_gradients,
                                       std::span<const glm::dvec3> posed_joint_gradients = {}, bool canonical_stays = false);

}  // namespace arah
