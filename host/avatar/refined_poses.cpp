#include "host/avatar/refined_poses.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <numbers>
#include <set>
#include <stdexcept>

#include "host/input_error.h"

namespace arah {
namespace {

void put_poses(SafetensorsFile& file, const std::string& prefix, const std::vector<Pose>& poses) {
  std::vector<double> theta, roots;
  for (const Pose& pose : poses) {
    for (const glm::dvec3& rotation : pose.theta) theta.insert(theta.end(), {rotation.x, rotation.y, rotation.z});
    roots.insert(roots.end(), {pose.root_position.x, pose.root_position.y, pose.root_position.z});
  }
  const auto count = static_cast<int64_t>(poses.size());
  file.tensors[prefix + "theta"] = Tensor::from<double>({count, static_cast<int64_t>(poses.front().theta.size()), 3}, theta);
  file.tensors[prefix + "root_position"] = Tensor::from<double>({count, 3}, roots);
}

std::vector<double> finite_values(const SafetensorsFile& file, const std::string& name, const std::vector<int64_t>& shape) {
  std::vector<double> values = file.values<double>(name, shape);
  if (!std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); }))
    throw InputError(file.path.string(), fmt::format("tensor \"{}\"", name), "finite numbers", "others");
  return values;
}

std::vector<Pose> read_poses(const SafetensorsFile& file, const std::string& prefix, std::size_t count, std::size_t joints) {
  const auto frames = static_cast<int64_t>(count);
  const std::vector<double> theta = finite_values(file, prefix + "theta", {frames, static_cast<int64_t>(joints), 3}), roots = finite_values(file, prefix + "root_position", {frames, 3});
  std::vector<Pose> poses(count);
  for (std::size_t f = 0; f < count; ++f) {
    for (std::size_t j = 0; j < joints; ++j) {
      const double* at = &theta[3 * (f * joints + j)];
      poses[f].theta.emplace_back(at[0], at[1], at[2]);
    }
    poses[f].root_position = {roots[3 * f], roots[3 * f + 1], roots[3 * f + 2]};
  }
  return poses;
}

}  // namespace

void put_refined_poses(SafetensorsFile& file, const RefinedPoses& refined) {
  if (refined.empty()) return;
  file.tensors["refined.frames"] = Tensor::from<int64_t>({static_cast<int64_t>(refined.frames.size())}, std::vector<int64_t>(refined.frames.begin(), refined.frames.end()));
  put_poses(file, "refined.", refined.poses);
  put_poses(file, "refined.start_", refined.starts);
  if (!refined.start_shape.empty()) file.tensors["refined.start_shape"] = Tensor::from<double>({static_cast<int64_t>(refined.start_shape.size())}, refined.start_shape);
}

void put_shape(SafetensorsFile& file, const BodyTemplate& body) {
  if (body.shape.size() > 0) file.tensors["template.shape"] = Tensor::from<double>({static_cast<int64_t>(body.shape.size())}, body.shape.beta);
}

void read_shape(const SafetensorsFile& file, BodyTemplate* body) {
  if (file.tensors.contains("template.shape")) set_shape(*body, finite_values(file, "template.shape", {static_cast<int64_t>(body->shape.size())}));
}

RefinedPoses read_refined_poses(const SafetensorsFile& file, const BodyTemplate& body) {
  const std::size_t joints = body.skeleton.size();
  RefinedPoses refined;
  if (!file.tensors.contains("refined.frames")) return refined;
  const int64_t count = file.at("refined.frames").count();
  for (const int64_t number : file.values<int64_t>("refined.frames", {count})) {
    if (number < 0 || number > std::numeric_limits<int>::max()) throw InputError(file.path.string(), "tensor \"refined.frames\"", "frame numbers", fmt::format("{}", number));
    refined.frames.push_back(static_cast<int>(number));
  }
  if (count == 0 || std::set<int>(refined.frames.begin(), refined.frames.end()).size() != refined.frames.size())
    throw InputError(file.path.string(), "tensor \"refined.frames\"", "distinct frame numbers, at least one", count == 0 ? "none" : "one twice");
  refined.poses = read_poses(file, "refined.", refined.frames.size(), joints);
  refined.starts = read_poses(file, "refined.start_", refined.frames.size(), joints);
  if (file.tensors.contains("refined.start_shape")) refined.start_shape = finite_values(file, "refined.start_shape", {static_cast<int64_t>(body.shape.size())});
  return refined;
}

const Pose& pose_to_render(const RefinedPoses& refined, const std::string& split, const MotionFrame& frame) {
  const auto found = std::find(refined.frames.begin(), refined.frames.end(), frame.number);
  if (split != "train" || found == refined.frames.end()) return frame.pose;
  return refined.poses[static_cast<std::size_t>(found - refined.frames.begin())];
}

PoseDistance pose_distance(const Skeleton& skeleton, const std::vector<Pose>& poses, const Skeleton& other, const std::vector<Pose>& others) {
  if (skeleton.size() != other.size()) throw std::invalid_argument(fmt::format("{} joints and {}", skeleton.size(), other.size()));
  if (poses.size() != others.size()) throw std::invalid_argument(fmt::format("{} poses and {}", poses.size(), others.size()));
  PoseDistance distance{poses.size(), 0, 0};
  const double share = 1.0 / static_cast<double>(std::max<std::size_t>(poses.size() * skeleton.size(), 1));
  for (std::size_t f = 0; f < poses.size(); ++f) {
    const std::vector<glm::dmat4> a = forward_kinematics(skeleton, poses[f]), b = forward_kinematics(other, others[f]);
    const glm::dvec3 shift = root_translation(skeleton, poses[f]) - root_translation(other, others[f]);
    for (std::size_t j = 0; j < skeleton.size(); ++j) {
      distance.joints += share * glm::length(glm::dvec3(a[j][3]) - glm::dvec3(b[j][3]) + shift);
      const glm::dmat3 turn = glm::transpose(rotation_from_axis_angle(poses[f].theta[j])) * rotation_from_axis_angle(others[f].theta[j]);
      distance.rotations += share * glm::length(axis_angle_from_rotation(turn));
    }
  }
  return distance;
}

PoseImprovement pose_improvement(const RefinedPoses& refined, const BodyTemplate& body, const Skeleton& truth, const Motion& motion) {
  std::vector<Pose> given, starts, poses;
  for (std::size_t f = 0; f < refined.frames.size(); ++f) {
    const MotionFrame* frame = find_frame(motion, refined.frames[f]);
    if (!frame) continue;
    given.push_back(frame->pose);
    starts.push_back(refined.starts[f]);
    poses.push_back(refined.poses[f]);
  }
  const Skeleton before = refined.start_shape.empty() ? body.skeleton : skeleton_in_shape(body, refined.start_shape);
  return {pose_distance(before, starts, truth, given), pose_distance(body.skeleton, poses, truth, given)};
}

std::string describe(const PoseImprovement& improvement) {
  constexpr double degrees = 180 / std::numbers::pi;
  const auto& [before, after] = improvement;
  return fmt::format("poses: joints {:.2f} mm from the capture's before training, {:.2f} mm after; rotations {:.2f}° and {:.2f}° ({} frames)", 1e3 * before.joints, 1e3 * after.joints,
                     degrees * before.rotations, degrees * after.rotations, after.frames);
}

}  // namespace arah
