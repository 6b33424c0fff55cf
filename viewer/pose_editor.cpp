#include "viewer/pose_editor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include "host/body/retarget.h"

namespace arah {
namespace {

void check_joints(std::size_t expected, std::size_t found) {
  if (expected != found) throw std::invalid_argument(fmt::format("edits of {} joints for a pose of {}", found, expected));
}

// Where no joint has a turn, as edits that never had one.
PoseEdits plainest(PoseEdits edits) {
  if (std::all_of(edits.turns.begin(), edits.turns.end(), [](const glm::dvec3& turn) { return turn == glm::dvec3(0.0); })) edits.turns.clear();
  return edits;
}

// The first of these pairs of words that the name has, changed to the other; empty where it has none.
std::string other_name(const std::string& name) {
  static const std::pair<std::string, std::string> words[] = {{"left", "right"}, {"Left", "Right"}, {"LEFT", "RIGHT"}};
  for (const auto& [left, right] : words)
    for (const auto& [from, to] : {std::pair(left, right), std::pair(right, left)})
      if (const std::size_t at = name.find(from); at != std::string::npos) return std::string(name).replace(at, from.size(), to);
  if (name.size() > 2) {
    const std::string signs = "._-", end = name.substr(name.size() - 2);
    for (const auto& [from, to] : {std::pair('L', 'R'), std::pair('R', 'L'), std::pair('l', 'r'), std::pair('r', 'l')})
      if (signs.find(end[0]) != std::string::npos && end[1] == from) return name.substr(0, name.size() - 1) + to;
  }
  return "";
}

}  // namespace

Pose edited(const Pose& base, const PoseEdits& edits) {
  Pose pose = base;
  pose.root_position += edits.shift;
  if (edits.turns.empty()) return pose;
  check_joints(base.theta.size(), edits.turns.size());
  for (std::size_t j = 0; j < edits.turns.size(); ++j)
    if (edits.turns[j] != glm::dvec3(0.0)) pose.theta[j] = axis_angle_near(rotation_from_axis_angle(base.theta[j]) * rotation_from_axis_angle(edits.turns[j]), base.theta[j]);
  return pose;
}

PoseEdits edits_between(const Pose& base, const Pose& wanted, const PoseEdits& near) {
  check_joints(base.theta.size(), wanted.theta.size());
  PoseEdits edits{std::vector<glm::dvec3>(base.theta.size(), glm::dvec3(0.0)), wanted.root_position - base.root_position};
  for (std::size_t j = 0; j < base.theta.size(); ++j) {
    if (wanted.theta[j] == base.theta[j]) continue;
    const glm::dmat3 turn = glm::transpose(rotation_from_axis_angle(base.theta[j])) * rotation_from_axis_angle(wanted.theta[j]);
    edits.turns[j] = axis_angle_near(turn, j < near.turns.size() ? near.turns[j] : glm::dvec3(0.0));
  }
  return plainest(std::move(edits));
}

PoseEdits without_edit(const PoseEdits& edits, int joint) {
  PoseEdits rest = edits;
  if (joint == 0) rest.shift = glm::dvec3(0.0);
  if (!rest.turns.empty()) rest.turns.at(static_cast<std::size_t>(joint)) = glm::dvec3(0.0);
  return plainest(std::move(rest));
}

glm::dvec3 slider_angles(const glm::dvec3& axis_angle) {
  const glm::dmat3 R = rotation_from_axis_angle(axis_angle);  // R[column][row]
  const double cosine = std::hypot(R[0][0], R[0][1]);         // of y
  const double y = std::atan2(-R[0][2], cosine);
  if (cosine < 1e-9) return {0, y, std::atan2(-R[1][0], R[1][1])};
  return {std::atan2(R[1][2], R[2][2]), y, std::atan2(R[0][1], R[0][0])};
}

glm::dvec3 axis_angle_of_sliders(const glm::dvec3& angles) {
  return axis_angle_from_rotation(rotation_from_axis_angle({0, 0, angles.z}) * rotation_from_axis_angle({0, angles.y, 0}) * rotation_from_axis_angle({angles.x, 0, 0}));
}

std::vector<int> other_side(const Skeleton& skeleton) {
  std::map<std::string, int> named;
  for (const NamedJoint& joint : smpl_names(skeleton)) named.emplace(joint.name, joint.joint);
  std::vector<int> other(skeleton.size());
  for (std::size_t j = 0; j < other.size(); ++j) {
    const int found = find_joint(skeleton, other_name(skeleton.names[j]));
    other[j] = found < 0 ? static_cast<int>(j) : found;
  }
  for (const auto& [name, joint] : named)
    if (const auto found = named.find(other_name(name)); found != named.end() && found->second != joint) other[static_cast<std::size_t>(joint)] = found->second;
  return other;
}

Pose copied_across(const Skeleton& skeleton, const Pose& pose, int joint) {
  if (joint < 0 || static_cast<std::size_t>(joint) >= skeleton.size()) throw std::out_of_range(fmt::format("joint {} of {}", joint, skeleton.size()));
  check_joints(skeleton.size(), pose.theta.size());
  const std::vector<bool> below = chain_below(skeleton, joint);
  const std::vector<int> other = other_side(skeleton);
  const glm::dvec3 left = rest_axes(skeleton)[0];
  Pose mirrored = pose;
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    if (!below[j] || other[j] == static_cast<int>(j)) continue;
    // A turn's axis is no arrow: in a mirror it keeps what points to the side, and turns round what lies in the mirror.
    mirrored.theta[static_cast<std::size_t>(other[j])] = 2 * glm::dot(left, pose.theta[j]) * left - pose.theta[j];
  }
  return mirrored;
}

void EditHistory::keep() {
  if (shown_ == entries_[at_]) return;
  entries_.resize(at_ + 1);
  entries_.push_back(shown_);
  if (entries_.size() > kMost) entries_.erase(entries_.begin());
  at_ = entries_.size() - 1;
}

void EditHistory::undo() {
  if (shown_ == entries_[at_] && at_ > 0) --at_;
  shown_ = entries_[at_];
}

void EditHistory::redo() {
  if (can_redo()) shown_ = entries_[++at_];
}

std::optional<int> joint_under(const Camera& camera, std::span<const glm::dvec3> joints, glm::dvec2 cursor, double pixels) {
  std::optional<int> found;
  double least = pixels, depth = std::numeric_limits<double>::infinity();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const double z = camera.to_camera(joints[j]).z;
    if (!(z >= kNearPlane)) continue;
    const double distance = glm::length(camera.project(joints[j]) - cursor);
    if (!(distance < least || (distance == least && z < depth))) continue;
    found = static_cast<int>(j);
    least = distance;
    depth = z;
  }
  return found;
}

HeldJoint taken(const Camera& camera, std::span<const glm::dvec3> joints, int joint, glm::dvec2 cursor) {
  if (joint < 0 || static_cast<std::size_t>(joint) >= joints.size()) throw std::invalid_argument(fmt::format("joint {} of {}", joint, joints.size()));
  const glm::dvec3& place = joints[static_cast<std::size_t>(joint)];
  const double depth = camera.to_camera(place).z;
  if (!(depth >= kNearPlane)) throw std::invalid_argument(fmt::format("joint {}, which is {} m in front of the camera and not seen", joint, depth));
  return {joint, depth, camera.project(place) - cursor};
}

glm::dvec3 wanted_place(const Camera& camera, const HeldJoint& held, glm::dvec2 cursor) {
  const glm::dvec2 pixel = cursor + held.offset;
  const PixelRay ray = camera.ray(pixel.x, pixel.y);
  return ray.origin + ray.direction * (held.depth / (camera.R * ray.direction).z);
}

Pose pulled(const Camera& camera, const Skeleton& skeleton, const Pose& pose, const HeldJoint& held, glm::dvec2 cursor, int most_turning) {
  return dragged(skeleton, pose, held.joint, wanted_place(camera, held, cursor), most_turning);
}

}  // namespace arah
