// Between two poses.
#pragma once

#include <glm/vec3.hpp>

#include "host/body/pose.h"

namespace arah {

// From the rotation a (weight 0) to b (1), axis-angles, the shorter way round at an even pace (Shoemake's slerp); one of the two ways where
// they are half a turn apart. Ends are a's and b's own numbers; between, the angle is in [0, π].
glm::dvec3 blended_rotation(const glm::dvec3& a, const glm::dvec3& b, double weight);

// Each joint so, the root's position on the straight line. The weight is taken into 0..1. Throws std::invalid_argument for poses of
// different numbers of joints or a weight that is no number.
Pose blended(const Pose& a, const Pose& b, double weight);

}  // namespace arah
