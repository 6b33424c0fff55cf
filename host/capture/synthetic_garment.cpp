// How the clothes of a synthetic figure move: skinning plus folds, gravity and lag.
#include <cmath>

#include "host/capture/synthetic_figure.h"

namespace arah {

namespace {

constexpr float kFoldHeight = 0.014f;    // m, for a joint bent far
constexpr float kGravityReach = 0.045f;  // m, hem of a figure that hangs head down moves twice as far
constexpr double kLagSeconds = 0.06;     // a loose hem is where skinning had it this long ago
constexpr float kLagLimit = 0.030f;      // m
constexpr float kInwardLimit = 0.008f;   // m, what a garment may come closer to the body than at rest

glm::dmat4 blend(const std::vector<glm::dmat4>& transforms, const glm::u8vec4& joints, const glm::vec4& weights) {
  glm::dmat4 sum(0.0);
  for (int k = 0; k < 4; ++k)
    if (weights[k] > 0) sum += static_cast<double>(weights[k]) * transforms[joints[k]];
  return sum;
}

// Smoothly bounded: the identity near 0, never longer than `limit`.
glm::vec3 saturated(const glm::vec3& v, float limit) {
  return v * (limit / (limit + glm::length(v)));
}

// How far a joint's bend folds the cloth about it: 0 at rest, towards 1 from about 90 degrees.
float fold_amount(double angle) {
  return static_cast<float>(angle * angle / (0.35 + angle * angle));
}

}  // namespace

std::vector<glm::vec3> skinned_surface(const ClothedFigure& figure, const Pose& pose) {
  const std::vector<glm::dmat4> transforms = rest_to_posed(figure.body.skeleton, pose);
  const glm::dvec3 translation = root_translation(figure.body.skeleton, pose);
  std::vector<glm::vec3> posed(figure.rest.size());
  for (std::size_t i = 0; i < posed.size(); ++i) {
    const glm::dmat4 m = blend(transforms, figure.joints[i], figure.weights[i]);
    posed[i] = glm::vec3(glm::dvec3(m * glm::dvec4(figure.rest[i], 1.0)) + translation);
  }
  return posed;
}

PosedSurface pose_surface(const ClothedFigure& figure, const Pose& pose, const Pose& previous_pose, double seconds) {
  const Skeleton& skeleton = figure.body.skeleton;
  const std::vector<glm::dmat4> transforms = rest_to_posed(skeleton, pose);
  const glm::dvec3 translation = root_translation(skeleton, pose);
  const std::vector<glm::vec3> before = skinned_surface(figure, previous_pose);
  std::vector<float> bend(skeleton.size()), angle(skeleton.size());
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    angle[j] = static_cast<float>(glm::length(pose.theta[j]));
    bend[j] = fold_amount(angle[j]);
  }
  const float scale = static_cast<float>(figure.scale);

  PosedSurface posed;
  posed.positions.resize(figure.rest.size());
  posed.normals.assign(figure.rest.size(), glm::vec3(0));
  for (std::size_t i = 0; i < figure.rest.size(); ++i) {
    const glm::dmat4 m = blend(transforms, figure.joints[i], figure.weights[i]);
    const glm::vec3 skinned(glm::dvec3(m * glm::dvec4(figure.rest[i], 1.0)) + translation);
    posed.positions[i] = skinned;
    const float loose = figure.looseness[i];
    if (loose <= 0) continue;
    const glm::mat3 turn{glm::dmat3(m)};
    const glm::vec3 normal = glm::normalize(turn * figure.normals[i]);

    float height = 0;
    for (const Fold& fold : figure.folds[i])
      height += bend[fold.joint] * fold.strength * (0.5f + 0.5f * std::sin(fold.phase + 1.5f * angle[fold.joint]));
    // Down at rest is -Y of the template, in the world -Z.
    const glm::vec3 gravity = glm::vec3(0, 0, -1) - turn * glm::vec3(0, -1, 0);
    const glm::vec3 velocity = (skinned - before[i]) / static_cast<float>(seconds);
    const glm::vec3 lag = saturated(-static_cast<float>(kLagSeconds) * velocity, kLagLimit * scale);
    glm::vec3 offset = loose * (kGravityReach * scale * gravity + lag);
    const float inward = -glm::dot(offset, normal), limit = kInwardLimit * scale * loose;
    if (inward > 0) offset += normal * (inward - inward * limit / (limit + inward));
    posed.positions[i] = skinned + offset + normal * (kFoldHeight * scale * height);
  }
  for (const glm::uvec3& t : figure.triangles) {
    const glm::vec3& a = posed.positions[t.x];
    const glm::vec3 area = glm::cross(posed.positions[t.y] - a, posed.positions[t.z] - a);
    for (int k = 0; k < 3; ++k) posed.normals[t[k]] += area;
  }
  for (glm::vec3& normal : posed.normals) {
    const float length = glm::length(normal);
    normal = length > 0 ? normal / length : glm::vec3(0, 0, 1);
  }
  return posed;
}

}  // namespace arah
