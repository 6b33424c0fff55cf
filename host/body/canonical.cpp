#include "host/body/canonical.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <string>

#include "host/input_error.h"

namespace arah {
namespace {

const double kSpread = glm::quarter_pi<double>();        // 45°
const double kHorizontalTolerance = glm::radians(20.0);  // A-poses lower the arms by 30° and more

const glm::dvec3& rest_joint(const Skeleton& skeleton, const std::string& name) {
  return skeleton.rest_joints[static_cast<std::size_t>(find_joint(skeleton, name))];
}

// Both upper arms (shoulder → elbow) lie within 20° of the horizontal.
bool rests_in_t_pose(const Skeleton& skeleton) {
  for (const std::string side : {"left", "right"}) {
    const std::string shoulder = side + "_shoulder";
    const std::string elbow = side + "_elbow";
    if (find_joint(skeleton, shoulder) < 0 || find_joint(skeleton, elbow) < 0) return false;
    const glm::dvec3 arm = rest_joint(skeleton, elbow) - rest_joint(skeleton, shoulder);
    if (std::abs(arm.y) > std::sin(kHorizontalTolerance) * glm::length(arm)) return false;
  }
  return true;
}

// The angle about z, outward positive, that brings the thigh to 45° off the downward vertical; 0 if it is there
// already. Turning about z keeps the thigh's length l and its part ρ in the x–y plane, so the angle α in that plane at
// which the thigh stands 45° off the vertical fulfils ρ cos α = l cos 45°. A thigh that points forward by more than 45°
// has none.
double outward_angle(const glm::dvec3& thigh, double outward) {
  const double in_plane = std::hypot(thigh.x, thigh.y);
  const double wanted = glm::length(thigh) * std::cos(kSpread);
  if (wanted >= in_plane) return 0.0;
  const double now = std::atan2(outward * thigh.x, -thigh.y);
  return std::max(0.0, std::acos(wanted / in_plane) - now);
}

}  // namespace

CanonicalPose make_canonical_pose(const Skeleton& skeleton) {
  CanonicalPose canonical{std::vector<glm::dmat4>(skeleton.size(), glm::dmat4(1.0))};
  if (!has_smpl_legs(skeleton)) return canonical;
  const bool t_pose = rests_in_t_pose(skeleton);
  for (const std::string side : {"left", "right"}) {
    const double outward = side == "left" ? 1.0 : -1.0;  // the side's direction along x
    const int hip = find_joint(skeleton, side + "_hip");
    const glm::dvec3 center = skeleton.rest_joints[static_cast<std::size_t>(hip)];
    const double angle = t_pose ? kSpread : outward_angle(rest_joint(skeleton, side + "_knee") - center, outward);
    // Every bone of the chain turns as one about the hip: V = T(J_hip) R T(−J_hip).
    const glm::dmat4 turn = glm::translate(
        glm::rotate(glm::translate(glm::dmat4(1.0), center), outward * angle, glm::dvec3(0.0, 0.0, 1.0)), -center);
    const std::vector<bool> chain = chain_below(skeleton, hip);
    for (std::size_t j = 0; j < skeleton.size(); ++j) {
      if (chain[j]) canonical.rest_to_canonical[j] = turn;
    }
  }
  return canonical;
}

std::vector<glm::dmat4> bone_transforms(const Skeleton& skeleton, const CanonicalPose& canonical, const Pose& pose) {
  std::vector<glm::dmat4> transforms = rest_to_posed(skeleton, pose);
  for (std::size_t j = 0; j < transforms.size(); ++j) {
    // V is rigid: V⁻¹ = [Rᵀ | −Rᵀ t].
    const glm::dmat4& v = canonical.rest_to_canonical.at(j);
    const glm::dmat3 transposed = glm::transpose(glm::dmat3(v));
    glm::dmat4 inverse(transposed);
    inverse[3] = glm::dvec4(-(transposed * glm::dvec3(v[3])), 1.0);
    transforms[j] = transforms[j] * inverse;
  }
  return transforms;
}

std::vector<std::pair<glm::dvec3, glm::dvec3>> bone_segments(const Skeleton& skeleton, const CanonicalPose& canonical) {
  std::vector<glm::dvec3> joints;
  for (std::size_t j = 0; j < skeleton.size(); ++j) joints.emplace_back(canonical.rest_to_canonical.at(j) * glm::dvec4(skeleton.rest_joints[j], 1.0));
  std::vector<std::pair<glm::dvec3, glm::dvec3>> segments;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    glm::dvec3 sum(0.0);
    int children = 0;
    for (std::size_t child = 0; child < joints.size(); ++child)
      if (skeleton.parents[child] == static_cast<int>(j)) sum += joints[child], ++children;
    segments.emplace_back(joints[j], children ? sum / static_cast<double>(children) : joints[j]);
  }
  return segments;
}

std::vector<glm::dvec3> canonical_vertices(const BodyTemplate& body_template, const CanonicalPose& canonical) {
  return skinned_vertices(body_template, canonical.rest_to_canonical);
}

glm::dvec3 CubeNormalization::to_cube(const glm::dvec3& x) const {
  const double r = cmax - cmin;
  return 2.0 * ((x - center) - cmin + 0.05 * r) / (1.1 * r) - 1.0;
}

glm::dvec3 CubeNormalization::from_cube(const glm::dvec3& n) const {
  const double r = cmax - cmin;
  return (n / 2.0 + 0.5) * (1.1 * r) + cmin - 0.05 * r + center;
}

CubeNormalization cube_normalization(std::span<const glm::dvec3> vertices) {
  if (vertices.empty()) throw InputError("template", "vertices", "at least two", "none");
  CubeNormalization cube;
  for (const glm::dvec3& vertex : vertices) cube.center += vertex / static_cast<double>(vertices.size());
  cube.cmin = std::numeric_limits<double>::infinity();
  cube.cmax = -cube.cmin;
  for (const glm::dvec3& vertex : vertices) {
    const glm::dvec3 d = vertex - cube.center;
    cube.cmin = std::min({cube.cmin, d.x, d.y, d.z});
    cube.cmax = std::max({cube.cmax, d.x, d.y, d.z});
  }
  if (!(cube.cmax > cube.cmin) || !std::isfinite(cube.cmax - cube.cmin)) {
    throw InputError("template", "vertices", "a body with an extent",
                     fmt::format("coordinates from {} to {} about their mean", cube.cmin, cube.cmax));
  }
  return cube;
}

}  // namespace arah
