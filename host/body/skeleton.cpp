#include "host/body/skeleton.h"

#include <cmath>
#include <set>

#include "host/input_error.h"

namespace arah {

void validate_skeleton(const Skeleton& skeleton, const std::string& where) {
  const std::size_t count = skeleton.parents.size();
  if (skeleton.names.size() != count || skeleton.rest_joints.size() != count) {
    throw InputError(where, "skeleton", "as many names and rest positions as parents",
                     fmt::format("{} names, {} parents, {} rest positions", skeleton.names.size(), count,
                                 skeleton.rest_joints.size()));
  }
  if (count < 1 || count > kMaxJoints) {
    throw InputError(where, "skeleton", fmt::format("1 to {} joints", kMaxJoints), fmt::format("{}", count),
                     count > kMaxJoints ? "Merge the finest joints (fingers, face) into their parents." : "");
  }
  std::set<std::string> seen;
  for (std::size_t j = 0; j < count; ++j) {
    const std::string joint = fmt::format("joint {} ('{}')", j, skeleton.names[j]);
    if (skeleton.names[j].empty()) throw InputError(where, joint, "a name", "an empty one");
    if (!seen.insert(skeleton.names[j]).second) {
      throw InputError(where, joint, "distinct joint names", "this name twice");
    }
    const int parent = skeleton.parents[j];
    if (j == 0 ? parent != -1 : (parent < 0 || parent >= static_cast<int>(j))) {
      throw InputError(where, joint, j == 0 ? "the root first, with parent -1" : "a parent that comes before it",
                       fmt::format("parent {}", parent));
    }
    const glm::dvec3& position = skeleton.rest_joints[j];
    if (!std::isfinite(position.x) || !std::isfinite(position.y) || !std::isfinite(position.z)) {
      throw InputError(where, joint, "a finite rest position",
                       fmt::format("({}, {}, {})", position.x, position.y, position.z));
    }
  }
}

int find_joint(const Skeleton& skeleton, std::string_view name) {
  for (std::size_t j = 0; j < skeleton.names.size(); ++j) {
    if (skeleton.names[j] == name) return static_cast<int>(j);
  }
  return -1;
}

bool has_smpl_legs(const Skeleton& skeleton) {
  for (const std::string side : {"left", "right"}) {
    const int hip = find_joint(skeleton, side + "_hip");
    const int knee = find_joint(skeleton, side + "_knee");
    if (hip < 0 || knee < 0 || skeleton.parents[static_cast<std::size_t>(knee)] != hip) return false;
  }
  return true;
}

std::vector<bool> chain_below(const Skeleton& skeleton, int ancestor) {
  std::vector<bool> below(skeleton.size(), false);
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const int parent = skeleton.parents[j];
    below[j] = static_cast<int>(j) == ancestor || (parent >= 0 && below[static_cast<std::size_t>(parent)]);
  }
  return below;
}

}  // namespace arah
