#include "host/body/pose_blend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <stdexcept>

namespace arah {
namespace {

glm::dquat turn_as_quaternion(const glm::dvec3& axis_angle) { return glm::quat_cast(rotation_from_axis_angle(axis_angle)); }

}  // namespace

glm::dvec3 blended_rotation(const glm::dvec3& a, const glm::dvec3& b, double weight) {
  if (weight <= 0.0 || a == b) return a;
  if (weight >= 1.0) return b;
  return axis_angle_from_rotation(glm::mat3_cast(glm::slerp(turn_as_quaternion(a), turn_as_quaternion(b), weight)));
}

Pose blended(const Pose& a, const Pose& b, double weight) {
  if (a.theta.size() != b.theta.size()) throw std::invalid_argument(fmt::format("poses of {} and {} joints to blend", a.theta.size(), b.theta.size()));
  if (std::isnan(weight)) throw std::invalid_argument("a weight that is no number to blend poses by");
  const double part = std::clamp(weight, 0.0, 1.0);
  Pose between = part < 1.0 ? a : b;
  if (part <= 0.0 || part >= 1.0) return between;
  between.root_position = glm::mix(a.root_position, b.root_position, part);
  for (std::size_t j = 0; j < a.theta.size(); ++j) between.theta[j] = blended_rotation(a.theta[j], b.theta[j], part);
  return between;
}

}  // namespace arah
