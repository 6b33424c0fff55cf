#include "host/body/inverse_kinematics.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <numbers>

namespace arah {
namespace {

constexpr int kSteps = 48;
constexpr double kLargestTurn = 0.3;  // radians a step
constexpr double kDamping = 0.02;     // λ² of a chain of length 1 at a distance of 1
constexpr double kThere = 1e-12;      // of the chain's length
constexpr double kAstray = 1e-6;      // of the pull that a turn could follow
constexpr double kBend = 0.01;        // radians

std::size_t joint_slot(int joint) { return static_cast<std::size_t>(joint); }

bool is_finite_vector(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

// Of any finite vector that is not 0, however long or short.
glm::dvec3 direction_of(const glm::dvec3& v) { return glm::normalize(v / std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)})); }

// Some unit vector across it.
glm::dvec3 across(const glm::dvec3& v) {
  const glm::dvec3 size = glm::abs(v);
  const glm::dvec3 axis = size.x <= size.y && size.x <= size.z ? glm::dvec3(1, 0, 0) : size.y <= size.z ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  return glm::normalize(glm::cross(v, axis));
}

glm::dmat3 cross_product_matrix(const glm::dvec3& v) { return {0.0, v.z, -v.y, -v.z, 0.0, v.x, v.y, -v.x, 0.0}; }

// The turning joints and the dragged one, which follows them.
class Chain {
 public:
  Chain(const Skeleton& skeleton, const Pose& pose, int joint, const std::vector<int>& turning) {
    const std::vector<glm::dmat4> frames = forward_kinematics(skeleton, pose);
    const glm::dvec3 shift = root_translation(skeleton, pose);
    for (auto j = turning.rbegin(); j != turning.rend(); ++j) {
      rotations_.emplace_back(frames[joint_slot(*j)]);
      joints_.push_back(glm::dvec3(frames[joint_slot(*j)][3]) + shift);
      const int below = std::next(j) == turning.rend() ? joint : *std::next(j);
      bones_.push_back(skeleton.rest_joints[joint_slot(below)] - skeleton.rest_joints[joint_slot(*j)]);
      longest_ = std::max(longest_, glm::length(bones_.back()));
      length_ += glm::length(bones_.back());
    }
    joints_.push_back(glm::dvec3(frames[joint_slot(joint)][3]) + shift);
  }

  double length() const { return length_; }
  const std::vector<glm::dmat3>& rotations() const { return rotations_; }  // joint → world, from above, as the turning joints
  bool finite_everywhere() const { return std::all_of(joints_.begin(), joints_.end(), is_finite_vector); }

  // The nearest point to `target` in the shell between what the chain reaches folded and straight.
  glm::dvec3 reachable(const glm::dvec3& target) const {
    const glm::dvec3& start = joints_.front();
    if (target == start && longest_ * 2 <= length_) return target;
    const glm::dvec3 direction = direction_of(target == start ? (joints_.back() == start ? glm::dvec3(0, 1, 0) : joints_.back() - start) : target - start);
    const double distance = glm::dot(target - start, direction);
    return start + direction * std::clamp(distance, std::max(0.0, 2 * longest_ - length_), length_);
  }

  // Turns of all joints by which the end comes nearer to `target`, in radians, world axes; empty where it is there.
  std::vector<glm::dvec3> step_towards(const glm::dvec3& target) const {
    const glm::dvec3 left = target - joints_.back();
    const double distance = glm::length(left);
    if (distance <= kThere * length_) return {};
    const std::size_t count = rotations_.size();
    std::vector<glm::dvec3> turns(count);
    glm::dmat3 normal(kDamping * length_ * distance);
    double pull = 0;  // |Jᵀ e|
    for (std::size_t i = 0; i < count; ++i) {
      const glm::dvec3 lever = joints_.back() - joints_[i];
      normal += glm::dot(lever, lever) * glm::dmat3(1.0) - glm::outerProduct(lever, lever);  // [l]× [l]×ᵀ
      pull = std::max(pull, glm::length(glm::cross(lever, left)));
    }
    if (pull <= kAstray * length_ * distance) {
      turns.back() = kBend * across(direction_of(bones_.back() == glm::dvec3(0.0) ? glm::dvec3(0, 1, 0) : rotations_.back() * bones_.back()));
      return turns;
    }
    const glm::dvec3 solved = glm::inverse(normal) * left;
    double largest = 0;
    for (std::size_t i = 0; i < count; ++i) {
      turns[i] = glm::cross(joints_.back() - joints_[i], solved);
      largest = std::max(largest, glm::length(turns[i]));
    }
    const double share = largest > kLargestTurn ? kLargestTurn / largest : 1.0;
    for (glm::dvec3& turn : turns) turn *= share;
    return turns;
  }

  // Each joint by its turn, and along with those above it.
  void turn(const std::vector<glm::dvec3>& turns) {
    glm::dmat3 along(1.0);
    for (std::size_t i = 0; i < turns.size(); ++i) {
      along *= rotation_from_axis_angle(turns[i]);
      rotations_[i] = along * rotations_[i];
      joints_[i + 1] = joints_[i] + rotations_[i] * bones_[i];
    }
  }

 private:
  std::vector<glm::dmat3> rotations_;  // [n]
  std::vector<glm::dvec3> joints_;     // [n + 1] world; the last is the dragged one
  std::vector<glm::dvec3> bones_;      // [n] at rest, to the next
  double length_ = 0, longest_ = 0;
};

}  // namespace

std::vector<glm::dvec3> posed_joints(const Skeleton& skeleton, const Pose& pose) {
  std::vector<glm::dvec3> joints;
  for (const glm::dmat4& frame : forward_kinematics(skeleton, pose)) joints.push_back(glm::dvec3(frame[3]) + root_translation(skeleton, pose));
  return joints;
}

glm::dvec3 axis_angle_near(const glm::dmat3& rotation, const glm::dvec3& near) {
  const glm::dvec3 least = axis_angle_from_rotation(rotation);
  const double angle = glm::length(least), full = 2 * std::numbers::pi;
  const glm::dvec3 axis = angle > 1e-9 ? least / angle : glm::dot(near, near) > 1 ? glm::normalize(near) : glm::dvec3(0.0);
  return least + axis * full * std::round((glm::dot(near, axis) - glm::dot(least, axis)) / full);
}

Pose turned_in_world(const Skeleton& skeleton, const Pose& pose, int joint, const glm::dvec3& turn) {
  const std::vector<glm::dmat4> frames = forward_kinematics(skeleton, pose);
  const int parent = skeleton.parents.at(joint_slot(joint));
  const glm::dmat3 above = parent < 0 ? glm::dmat3(1.0) : glm::dmat3(frames[joint_slot(parent)]);
  Pose turned = pose;
  turned.theta[joint_slot(joint)] = axis_angle_near(glm::transpose(above) * rotation_from_axis_angle(turn) * glm::dmat3(frames[joint_slot(joint)]), pose.theta[joint_slot(joint)]);
  return turned;
}

std::vector<int> turning_joints(const Skeleton& skeleton, int joint, int most) {
  std::vector<int> turning;
  for (int j = skeleton.parents.at(joint_slot(joint)); j >= 0 && static_cast<int>(turning.size()) < most; j = skeleton.parents[joint_slot(j)]) {
    const bool ends = j == 0 || std::count(skeleton.parents.begin(), skeleton.parents.end(), j) > 1;
    if (ends && !turning.empty()) break;
    turning.push_back(j);
    if (ends) break;
  }
  return turning;
}

std::vector<glm::dmat3> joint_jacobian(const Skeleton& skeleton, const Pose& pose, int joint, std::span<const int> turning) {
  const std::vector<glm::dvec3> joints = posed_joints(skeleton, pose);
  std::vector<glm::dmat3> jacobian;
  for (const int j : turning) jacobian.push_back(-cross_product_matrix(joints.at(joint_slot(joint)) - joints.at(joint_slot(j))));
  return jacobian;
}

Pose dragged(const Skeleton& skeleton, const Pose& pose, int joint, const glm::dvec3& target, int most_turning) {
  const std::vector<int> turning = turning_joints(skeleton, joint, most_turning);
  if (!is_finite_vector(target)) return pose;
  Pose result = pose;
  if (joint == 0) {
    result.root_position = target;
    return result;
  }
  if (turning.empty()) return pose;
  Chain chain(skeleton, pose, joint, turning);
  if (!chain.finite_everywhere() || !(chain.length() > 0)) return pose;
  const glm::dvec3 goal = chain.reachable(target);
  bool moved = false;
  for (int step = 0; step < kSteps; ++step) {
    const std::vector<glm::dvec3> turns = chain.step_towards(goal);
    if (turns.empty()) break;
    chain.turn(turns);
    moved = true;
  }
  if (!moved) return pose;
  const int top = skeleton.parents[joint_slot(turning.back())];
  glm::dmat3 above = top < 0 ? glm::dmat3(1.0) : glm::dmat3(forward_kinematics(skeleton, pose)[joint_slot(top)]);
  for (std::size_t i = 0; i < turning.size(); ++i) {
    glm::dvec3& theta = result.theta[joint_slot(turning[turning.size() - 1 - i])];
    theta = axis_angle_near(glm::transpose(above) * chain.rotations()[i], theta);
    if (!is_finite_vector(theta)) return pose;  // bones of lengths whose squares no double holds
    above = chain.rotations()[i];
  }
  return result;
}

}  // namespace arah
