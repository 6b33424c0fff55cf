#include "host/body/pose.h"

#include <fmt/format.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>
#include <stdexcept>

namespace arah {
namespace {

// sin x / x. Below 1e-4 the series 1 − x²/6 is exact to 1e-18.
double sinc(double x) {
  return std::abs(x) < 1e-4 ? 1.0 - x * x / 6.0 : std::sin(x) / x;
}

// [R | offset] as a 4×4 matrix.
glm::dmat4 rigid(const glm::dmat3& rotation, const glm::dvec3& offset) {
  glm::dmat4 result(rotation);
  result[3] = glm::dvec4(offset, 1.0);
  return result;
}

}  // namespace

Pose rest_pose(const Skeleton& skeleton) {
  return {std::vector<glm::dvec3>(skeleton.size(), glm::dvec3(0.0)), skeleton.rest_joints.at(0)};
}

glm::dmat3 rotation_from_axis_angle(const glm::dvec3& axis_angle) {
  const double angle = glm::length(axis_angle);
  const double a = sinc(angle);
  const double half = sinc(0.5 * angle);
  const double b = 0.5 * half * half;
  const glm::dvec3& v = axis_angle;
  const glm::dmat3 cross(0.0, v.z, -v.y, -v.z, 0.0, v.x, v.y, -v.x, 0.0);  // columns of K
  return glm::dmat3(1.0) + a * cross + b * (cross * cross);
}

glm::dvec3 axis_angle_from_rotation(const glm::dmat3& rotation) {
  glm::dquat q = glm::normalize(glm::quat_cast(rotation));
  if (q.w < 0.0) q = -q;
  const glm::dvec3 v(q.x, q.y, q.z);
  const double sine = glm::length(v);  // of half the angle
  if (sine < 1e-12) return 2.0 * v;
  return v * (2.0 * std::atan2(sine, q.w) / sine);
}

glm::dmat3 shortest_turn(const glm::dvec3& from, const glm::dvec3& to) {
  const glm::dvec3 axis = glm::cross(from, to);
  const double sine = glm::length(axis), cosine = glm::dot(from, to);
  if (sine > 1e-9) return rotation_from_axis_angle(axis / sine * std::atan2(sine, cosine));
  if (cosine > 0) return glm::dmat3(1.0);
  const glm::dvec3 other = std::abs(from.x) < 0.7 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  return rotation_from_axis_angle(glm::pi<double>() * glm::normalize(glm::cross(from, other)));
}

std::vector<glm::dmat4> forward_kinematics(const Skeleton& skeleton, const Pose& pose) {
  if (pose.theta.size() != skeleton.size()) {
    throw std::invalid_argument(
        fmt::format("a pose with {} rotations for a skeleton of {} joints", pose.theta.size(), skeleton.size()));
  }
  std::vector<glm::dmat4> joints(skeleton.size());
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const glm::dmat3 rotation = rotation_from_axis_angle(pose.theta[j]);
    if (skeleton.parents[j] < 0) {
      joints[j] = rigid(rotation, skeleton.rest_joints[j]);
    } else {
      const std::size_t parent = static_cast<std::size_t>(skeleton.parents[j]);
      joints[j] = joints[parent] * rigid(rotation, skeleton.rest_joints[j] - skeleton.rest_joints[parent]);
    }
  }
  return joints;
}

std::vector<glm::dmat4> rest_to_posed(const Skeleton& skeleton, const Pose& pose) {
  std::vector<glm::dmat4> transforms = forward_kinematics(skeleton, pose);
  for (std::size_t j = 0; j < transforms.size(); ++j) {
    transforms[j] = glm::translate(transforms[j], -skeleton.rest_joints[j]);
  }
  return transforms;
}

glm::dvec3 root_translation(const Skeleton& skeleton, const Pose& pose) {
  return pose.root_position - skeleton.rest_joints.at(0);
}

std::vector<glm::dvec3> skinned_vertices(const BodyTemplate& body_template, const std::vector<glm::dmat4>& transforms) {
  std::vector<glm::dvec3> result(body_template.vertices.size());
  for (std::size_t i = 0; i < result.size(); ++i) {
    const glm::dvec4 vertex(glm::dvec3(body_template.vertices[i]), 1.0);
    glm::dvec4 sum(0.0);
    for (int k = 0; k < 4; ++k) {
      const double weight = static_cast<double>(body_template.weights[i][k]);
      if (weight != 0.0) sum += weight * (transforms.at(body_template.joints[i][k]) * vertex);
    }
    result[i] = glm::dvec3(sum);
  }
  return result;
}

std::vector<glm::vec3> posed_vertices(const BodyTemplate& body_template, const Pose& pose) {
  const std::vector<glm::dvec3> local = skinned_vertices(body_template, rest_to_posed(body_template.skeleton, pose));
  const glm::dvec3 translation = root_translation(body_template.skeleton, pose);
  std::vector<glm::vec3> world(local.size());
  for (std::size_t i = 0; i < local.size(); ++i) world[i] = glm::vec3(local[i] + translation);
  return world;
}

std::vector<float> joint_rotations(const Pose& pose) {
  std::vector<float> rotations;
  for (std::size_t joint = 1; joint < pose.theta.size(); ++joint) {
    const glm::dmat3 rotation = rotation_from_axis_angle(pose.theta[joint]);
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column) rotations.push_back(static_cast<float>(rotation[column][row]));
  }
  return rotations;
}

}  // namespace arah
