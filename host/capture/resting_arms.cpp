#include "host/capture/resting_arms.h"

#include <fmt/format.h>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::array<const char*, 4> kArmJoints{"shoulder", "elbow", "wrist", "hand"};
constexpr std::array<const char*, 2> kArmSides{"left", "right"};

std::array<int, 4> arm_joints(const Skeleton& skeleton, std::size_t side) {
  std::array<int, 4> joints{};
  for (std::size_t i = 0; i < joints.size(); ++i) joints[i] = find_joint(skeleton, fmt::format("{}_{}", kArmSides[side], kArmJoints[i]));
  return joints;
}

// The linear blend of a vertex.
glm::dmat4 blended_by(const std::vector<glm::dmat4>& transforms, const glm::u8vec4& joints, const glm::vec4& weights) {
  glm::dmat4 sum(0.0);
  for (int k = 0; k < 4; ++k)
    if (weights[k] > 0) sum += static_cast<double>(weights[k]) * transforms[joints[k]];
  return sum;
}

void take_there(const std::vector<glm::dmat4>& transforms, const std::vector<glm::u8vec4>& joints, const std::vector<glm::vec4>& weights, std::vector<glm::vec3>& vertices, std::vector<glm::vec3>& normals) {
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const glm::dmat4 m = blended_by(transforms, joints[i], weights[i]);
    vertices[i] = glm::vec3(glm::dvec3(m * glm::dvec4(vertices[i], 1.0)));
    normals[i] = glm::vec3(glm::normalize(glm::dmat3(m) * glm::dvec3(normals[i])));
  }
}

}  // namespace

RestingArms resting_arms(const Skeleton& skeleton, const std::string& where) {
  RestingArms arms;
  for (std::size_t side = 0; side < 2; ++side) {
    const std::array<int, 4> joints = arm_joints(skeleton, side);
    for (std::size_t i = 0; i < joints.size(); ++i)
      if (joints[i] < 0) throw InputError(where, "joints", fmt::format("SMPL's {}_{}", kArmSides[side], kArmJoints[i]), "none of this name");
    for (std::size_t i = 0; i < 3; ++i) {
      const glm::dvec3 bone = skeleton.rest_joints[static_cast<std::size_t>(joints[i + 1])] - skeleton.rest_joints[static_cast<std::size_t>(joints[i])];
      const double length = glm::length(bone);
      if (!(length > 0)) throw InputError(where, fmt::format("{}_{}", kArmSides[side], kArmJoints[i]), "a bone to the next joint", "no length");
      arms.bones[side][i] = bone / length;
    }
  }
  return arms;
}

void rest_with(ClothedFigure& figure, const RestingArms& arms) {
  Skeleton& skeleton = figure.body.skeleton;
  const RestingArms now = resting_arms(skeleton, "figure");
  Pose pose = rest_pose(skeleton);
  for (std::size_t side = 0; side < 2; ++side) {
    const std::array<int, 4> joints = arm_joints(skeleton, side);
    glm::dmat3 turned(1.0);  // of the bone before
    for (std::size_t i = 0; i < 3; ++i) {
      const glm::dmat3 all = shortest_turn(turned * now.bones[side][i], arms.bones[side][i]) * turned;
      pose.theta[static_cast<std::size_t>(joints[i])] = axis_angle_from_rotation(glm::transpose(turned) * all);
      turned = all;
    }
  }
  const std::vector<glm::dmat4> transforms = rest_to_posed(skeleton, pose);
  take_there(transforms, figure.body.joints, figure.body.weights, figure.body.vertices, figure.body.normals);
  figure.body.glb.clear();
  figure.body.shape = {};  // its targets were of the rest before
  take_there(transforms, figure.joints, figure.weights, figure.rest, figure.normals);
  for (std::size_t j = 0; j < skeleton.size(); ++j) skeleton.rest_joints[j] = glm::dvec3(transforms[j] * glm::dvec4(skeleton.rest_joints[j], 1.0));
}

}  // namespace arah
