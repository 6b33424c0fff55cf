// The tree of joints that moves a body: names, parents and rest positions.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace arah {

// The most joints a rig may have. Shaders hold one joint's data in a lane and joint indices in a byte.
inline constexpr std::size_t kMaxJoints = 64;

// Joint j hangs from parents[j]; the root is joint 0 with parent -1, and parents[j] < j for all others.
// rest_joints: positions in the rest pose, metres, +Y up, +Z forward. Rest frames are world-aligned (identity
// rotation), as in SMPL, so a pose's rotations are about the world's axes at rest.
struct Skeleton {
  std::vector<std::string> names;
  std::vector<int> parents;
  std::vector<glm::dvec3> rest_joints;

  std::size_t size() const { return parents.size(); }
};

// Throws InputError, naming `where` (a file), unless there are 1..64 joints, the three lists are equally long, names
// are non-empty and distinct, the root comes first, parents come before children and all positions are finite.
void validate_skeleton(const Skeleton& skeleton, const std::string& where);

// Index of the joint called `name`, or -1.
int find_joint(const Skeleton& skeleton, std::string_view name);

// Whether the rig has SMPL's names for the two legs: left_hip → left_knee and right_hip → right_knee.
bool has_smpl_legs(const Skeleton& skeleton);

// For each joint, whether it is `ancestor` itself or hangs below it. Parents come before children, so one pass decides.
std::vector<bool> chain_below(const Skeleton& skeleton, int ancestor);

}  // namespace arah
