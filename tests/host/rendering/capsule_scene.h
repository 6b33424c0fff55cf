// A small subject for tests of rendering: a bending capsule with three joints, and a camera that sees it.
#pragma once

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "host/avatar/avatar.h"
#include "host/capture/camera.h"
#include "host/training/template_fit.h"
#include "host/training/training_settings.h"
#include "tests/kernels/device_fixture.h"

namespace arah {

// About the y axis from y = 0.4 to 1.2 m, radius 14 cm, with its joints at 0.45, 0.75 and 1.05 m.
inline BodyTemplate capsule_body() {
  constexpr double radius = 0.14, lower = 0.54, upper = 1.06;  // of the cylinder between the two half balls
  constexpr uint32_t around = 24, rings = 29;
  BodyTemplate body;
  for (int j = 0; j < 3; ++j) {
    body.skeleton.names.push_back("bone_" + std::to_string(j));
    body.skeleton.parents.push_back(j - 1);
    body.skeleton.rest_joints.emplace_back(0.0, 0.45 + 0.3 * j, 0.0);
  }
  const auto add = [&](double y, double r, double angle) {
    const glm::dvec3 p(r * std::sin(angle), y, r * std::cos(angle));
    const glm::dvec3 from_axis = p - glm::dvec3(0, std::min(std::max(y, lower), upper), 0);
    body.vertices.emplace_back(p);
    body.normals.emplace_back(from_axis / radius);
    // From each joint to the next over 16 cm about the middle one.
    const auto share = [&](double joint) { return std::min(std::max(0.5 + (y - joint) / 0.16, 0.0), 1.0); };
    const double second = share(0.75), third = share(1.05);
    body.joints.emplace_back(0, 1, 2, 0);
    body.weights.emplace_back(1 - second, second * (1 - third), second * third, 0);
  };
  // The profile by its length: quarter circle, straight line, quarter circle; the two tips are single vertices.
  const double quarter = 0.5 * std::numbers::pi * radius, length = 2 * quarter + upper - lower;
  add(lower - radius, 0, 0);
  for (uint32_t i = 1; i <= rings; ++i) {
    const double s = length * i / (rings + 1);
    double y = lower + s - quarter, r = radius;
    if (s < quarter) y = lower - radius * std::cos(s / radius), r = radius * std::sin(s / radius);
    if (s > length - quarter) y = upper + radius * std::cos((length - s) / radius), r = radius * std::sin((length - s) / radius);
    for (uint32_t k = 0; k < around; ++k) add(y, r, 2 * std::numbers::pi * k / around);
  }
  add(upper + radius, 0, 0);
  const auto at = [&](uint32_t ring, uint32_t k) { return 1 + ring * around + k % around; };
  const uint32_t last = 1 + rings * around;
  for (uint32_t k = 0; k < around; ++k) {
    body.triangles.emplace_back(0, at(0, k + 1), at(0, k));
    body.triangles.emplace_back(last, at(rings - 1, k), at(rings - 1, k + 1));
    for (uint32_t ring = 0; ring + 1 < rings; ++ring) {
      body.triangles.emplace_back(at(ring, k), at(ring, k + 1), at(ring + 1, k));
      body.triangles.emplace_back(at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k));
    }
  }
  return body;
}

inline Pose bent_pose(const Skeleton& skeleton) {
  Pose pose = rest_pose(skeleton);
  pose.theta[0] = {0.1, 0.7, 0.15};
  pose.theta[1] = {0.2, 0.0, -0.45};
  pose.theta[2] = {-0.1, 0.3, -0.4};
  pose.root_position += glm::dvec3(0.3, -0.2, 0.4);
  return pose;
}

// 2 m in front of the pose, looking along world −z: x right, y down.
inline Camera capsule_camera(int width, int height) {
  Camera camera;
  camera.name = "front";
  camera.width = width;
  camera.height = height;
  const double focal = 1.55 * height;
  camera.K = {focal, 0, 0, 0, focal, 0, 0.5 * width - 0.3, 0.5 * height + 0.2, 1};
  camera.R = {1, 0, 0, 0, -1, 0, 0, 0, -1};
  camera.T = -(camera.R * glm::dvec3(0.35, 0.55, 2.4));
  return camera;
}

// The parts of the preset `paper` in small and odd sizes.
inline AvatarSpec small_paper_spec() {
  AvatarSpec spec;
  spec.preset = "test";
  spec.skinning = {Skinning::network, 24, 2};
  spec.sdf = {24, 3, 30.0, SdfConditioning::latent, 16, 2};
  spec.color = {.width = 24, .hidden_layers = 3, .skip = 2, .narrow = 13, .view = true, .normal = true, .feature = true, .latent = true};
  spec.latent_size = 5;
  spec.b_init = 2e-3;
  return spec;
}

// With an SDF that follows the pose, by changes of low rank.
inline AvatarSpec following_the_pose(AvatarSpec spec) {
  spec.sdf.pose = PoseConditioning::low_rank;
  spec.sdf.pose_width = 16;
  spec.sdf.pose_hidden_layers = 2;
  return spec;
}

// The change begins at zero; from here on the pose shows.
inline void let_the_pose_show(Avatar& avatar, float deviation, std::mt19937_64& generator) {
  std::normal_distribution<float> normal(0, deviation);
  for (const TensorSlot& slot : avatar.layout.slots)
    if (slot.name.starts_with("low_rank.") && !slot.name.ends_with("V"))
      for (float& w : avatar.tensor(slot.name)) w += normal(generator);
}

// Fitted to the capsule.
inline Avatar capsule_avatar(Device& device, const AvatarSpec& spec) {
  const BodyTemplate body = capsule_body();
  const Pose pose = bent_pose(body.skeleton);
  Avatar avatar = make_avatar(spec, body, {0, 7}, 5, &pose);
  TrainingSettings settings;
  settings.seed = 5;
  settings.fit_steps = 200;
  settings.fit_skinning_steps = 150;
  settings.fit_rate = 2e-3;
  settings.fit_skinning_rate = 1e-2;
  settings.clothing = 0.01;
  const TemplateFit fit = fit_template(device, avatar, settings);
  std::printf("  fitted: sdf %.2f mm, weights %.3f\n", 1000 * fit.sdf_error, fit.skinning_error);
  return avatar;
}

}  // namespace arah
