#include "host/capture/synthetic_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace arah {

namespace {

glm::dmat3 about_x(double angle) {
  return rotation_from_axis_angle({angle, 0, 0});
}
glm::dmat3 about_y(double angle) {
  return rotation_from_axis_angle({0, angle, 0});
}
glm::dmat3 about_z(double angle) {
  return rotation_from_axis_angle({0, 0, angle});
}

// Sinusoids of the motion's period with phases drawn from the seed.
class Wave {
 public:
  Wave(double seconds, std::uint64_t seed) : turn_(seconds / kSyntheticMotionSeconds), random_(seed) {}

  // In [-1, 1], `cycles` times a motion, shifted by `phase` cycles and up to 0.06 more by the seed.
  double next(int cycles, double phase) {
    const double jitter = 0.06 * static_cast<double>(random_() >> 11) * 0x1p-53;
    return std::sin(2 * std::numbers::pi * (cycles * turn_ + phase + jitter));
  }

 private:
  double turn_;
  std::mt19937_64 random_;
};

// Angles of an upright person, radians, by side (0 left, 1 right); all 0 is a T-pose with arms level and legs straight
// down.
struct HumanPose {
  double yaw = 0, lean = 0, side_lean = 0, twist = 0;  // trunk: forward, towards the left, towards the left
  double head_turn = 0, head_nod = 0;
  double arm_down[2] = {}, arm_forward[2] = {}, arm_roll[2] = {}, elbow[2] = {}, wrist[2] = {};
  double hip[2] = {}, spread[2] = {}, knee[2] = {}, ankle[2] = {};
};

HumanPose training_pose(Wave wave) {
  HumanPose p;
  p.yaw = 0.9 * wave.next(1, 0.0);
  p.twist = 0.42 * wave.next(2, 0.15);
  p.lean = 0.10 + 0.16 * wave.next(1, 0.3);
  p.side_lean = 0.14 * wave.next(2, 0.6);
  p.head_turn = 0.35 * wave.next(1, 0.5);
  p.head_nod = 0.12 * wave.next(2, 0.2);
  for (int side = 0; side < 2; ++side) {
    const double half = 0.5 * side;
    p.arm_down[side] = 0.62 + 0.55 * wave.next(2, 0.75 + 0.35 * side);
    p.arm_forward[side] = 0.15 + 0.40 * wave.next(3, 0.1 + half);
    p.arm_roll[side] = 0.25 * wave.next(2, 0.4 + half);
    p.elbow[side] = 0.65 + 0.55 * wave.next(3, 0.3 + half);
    p.wrist[side] = 0.2 * wave.next(2, 0.1 + half);
    const double step = std::max(0.0, wave.next(4, half));
    p.hip[side] = 0.06 + 0.62 * step * step;
    p.knee[side] = 0.10 + 0.95 * step * step;
    p.ankle[side] = -0.04 + 0.25 * step * step;
    p.spread[side] = 0.05 + 0.05 * wave.next(1, 0.2 + half);
  }
  return p;
}

HumanPose novel_pose(Wave wave) {
  HumanPose p;
  const double bend = 0.5 - 0.5 * wave.next(2, 0.25);
  p.yaw = 0.5 - 0.7 * wave.next(1, 0.4);
  p.twist = 0.30 * wave.next(3, 0.0);
  p.lean = 0.05 + 0.42 * bend;
  p.side_lean = 0.26 * wave.next(1, 0.1);
  p.head_turn = 0.3 * wave.next(2, 0.7);
  p.head_nod = -0.3 * bend;
  for (int side = 0; side < 2; ++side) {
    p.arm_down[side] = -0.15 + 0.75 * wave.next(2, 0.3 + 0.22 * side);
    p.arm_forward[side] = 0.45 + 0.45 * wave.next(1, 0.6 + 0.5 * side);
    p.arm_roll[side] = 0.35 * wave.next(3, 0.5 * side);
    p.elbow[side] = 0.75 + 0.65 * wave.next(2, 0.05 + 0.3 * side);
    p.wrist[side] = 0.25 * wave.next(3, 0.6 + 0.5 * side);
    p.hip[side] = 0.08 + 0.95 * bend;
    p.knee[side] = 0.12 + 1.25 * bend;
    p.ankle[side] = -0.06 - 0.40 * bend;
    p.spread[side] = 0.10 + 0.14 * bend;
  }
  return p;
}

// Sets the named joints' rotations; joints that the rig lacks stay at rest.
void apply(const HumanPose& p, const Skeleton& skeleton, Pose& pose) {
  const auto set = [&](std::string_view name, const glm::dmat3& rotation) {
    const int joint = find_joint(skeleton, name);
    if (joint > 0) pose.theta[joint] = axis_angle_from_rotation(rotation);
  };
  const glm::dmat3 spine = about_y(p.twist / 3) * about_x(p.lean / 3) * about_z(-p.side_lean / 3);
  for (const char* name : {"spine1", "spine2", "spine3"}) set(name, spine);
  const glm::dmat3 head = about_y(0.5 * p.head_turn) * about_x(0.5 * p.head_nod);
  set("neck", head);
  set("head", head);
  for (int side = 0; side < 2; ++side) {
    const double s = side == 0 ? 1 : -1;  // the left side is +X; its mirror image turns the other way about y and z
    const std::string prefix = side == 0 ? "left_" : "right_";
    // Down from the horizontal: what the rest pose already hangs is taken off, so that A-poses and T-poses end alike.
    const int shoulder = find_joint(skeleton, prefix + "shoulder"), elbow = find_joint(skeleton, prefix + "elbow");
    double hangs = 0;
    if (shoulder >= 0 && elbow >= 0) {
      const glm::dvec3 arm = skeleton.rest_joints[elbow] - skeleton.rest_joints[shoulder];
      hangs = std::atan2(-arm.y, std::hypot(arm.x, arm.z));
    }
    const double down = p.arm_down[side] - hangs;
    set(prefix + "collar", about_z(-0.15 * s * down));
    set(prefix + "shoulder", about_y(-s * p.arm_forward[side]) * about_z(-0.85 * s * down) * about_x(p.arm_roll[side]));
    set(prefix + "elbow", about_y(-s * p.elbow[side]));
    set(prefix + "wrist", about_z(-s * p.wrist[side]));
    set(prefix + "hip", about_z(s * p.spread[side]) * about_x(-p.hip[side]));
    set(prefix + "knee", about_x(p.knee[side]));
    set(prefix + "ankle", about_x(p.ankle[side]) * about_z(-s * p.spread[side]));
  }
}

// For rigs whose joints mean nothing to us: each swings by up to 0.3 rad about an axis of its own.
void swing_joints(Wave wave, std::uint64_t seed, SyntheticSplit split, Pose& pose) {
  std::mt19937_64 random(seed * 2 + (split == SyntheticSplit::kNovel ? 1 : 0));
  const auto uniform = [&] { return 2.0 * static_cast<double>(random() >> 11) * 0x1p-53 - 1.0; };
  for (std::size_t j = 1; j < pose.theta.size(); ++j) {
    const double x = uniform(), y = uniform(), z = uniform(), phase = uniform();
    const double length = std::max(std::sqrt(x * x + y * y + z * z), 1e-3);
    const int cycles = 1 + static_cast<int>(j % 3);
    pose.theta[j] = 0.3 * wave.next(cycles, phase) / length * glm::dvec3(x, y, z);
  }
}

}  // namespace

Pose synthetic_pose(const ClothedFigure& figure, SyntheticSplit split, double seconds, std::uint64_t seed) {
  const Skeleton& skeleton = figure.body.skeleton;
  const Wave wave(seconds, seed * 2 + (split == SyntheticSplit::kNovel ? 1 : 0));
  Pose pose = rest_pose(skeleton);
  HumanPose human = split == SyntheticSplit::kTrain ? training_pose(wave) : novel_pose(wave);
  if (has_smpl_legs(skeleton)) {
    apply(human, skeleton, pose);
  } else {
    swing_joints(wave, seed, split, pose);
  }
  // From the template's +Y up to the world's +Z up, about the template's own left-right axis.
  pose.theta[0] =
      axis_angle_from_rotation(about_x(0.5 * std::numbers::pi) * about_y(human.yaw) * about_x(0.3 * human.lean));

  Wave sway(seconds, seed);
  const double reach = 0.07 * figure.scale;
  pose.root_position = {reach * sway.next(1, 0.1), reach * sway.next(2, 0.4), 0};
  float lowest = std::numeric_limits<float>::max();
  for (const glm::vec3& vertex : skinned_surface(figure, pose)) lowest = std::min(lowest, vertex.z);
  pose.root_position.z -= static_cast<double>(lowest);
  return pose;
}

}  // namespace arah
