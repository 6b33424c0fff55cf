#include "host/training/pose_refinement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <stdexcept>

#include "host/body/kinematics_gradient.h"
#include "host/input_error.h"
#include "kernels/reference/adam.h"
#include "kernels/skinning/bone_gradient.h"
#include "kernels/skinning/implicit_cotangent.h"

namespace arah {

PoseGradient::PoseGradient(Device& device, AvatarNetworks& networks, uint32_t rows, const BufferSlice& counts)
    : device_(device), joints_(networks.tree().joints()), stride_(padded_channels(joints_)), counts_(counts) {
  const uint64_t padded = padded_points(rows);
  auto make = [&](const char* what, uint64_t bytes) { return Buffer(device, std::string("pose gradient: ") + what, bytes, BufferPlace::device); };
  if (networks.spec().skinning.kind == Skinning::network) {
    weights_ = make("skinning weights", padded * stride_ * 4);
  } else {
    cotangents_ = make("cotangents", padded * 16);
  }
  partials_ = make("partial sums", bone_gradient_partials(rows, joints_));
  sums_ = make("of bone transforms", 12 * joints_ * 4ull);
}

void PoseGradient::record_clear(Commands& commands) { commands.fill(sums_.slice(), 0); }

void PoseGradient::record_add(Commands& commands, uint32_t rows, const BufferSlice& canonical, const BufferSlice& cotangents) {
  BoneGradientArgs args;
  args.rows = {{rows, {}}, {}};
  args.joints = joints_;
  args.cotangents = cotangents;
  args.canonical = canonical;
  args.weights = weights();
  args.partials = partials_.slice();
  args.gradients = sums_.slice();
  record_bone_gradient(commands, args);
}

void PoseGradient::record_add_by_vertex(Commands& commands, FrameOnDevice& frame, PointRootFinder& finder, const Rows& rows, const BufferSlice& canonical, const BufferSlice& upstream) {
  const uint32_t points = rows.range.points;
  record_implicit_cotangent(commands, {points, finder.record_transforms(commands, frame, rows, canonical), upstream, canonical, cotangents_.slice(), counts_});
  BoneGradientArgs args;
  args.rows = rows;
  args.joints = joints_;
  args.cotangents = cotangents_.slice();
  args.canonical = canonical;
  args.nearest = finder.nearest_vertices();
  args.target = frame.vertices();
  args.partials = partials_.slice();
  args.gradients = sums_.slice();
  record_bone_gradient(commands, args);
}

std::vector<float> PoseGradient::download() { return device_.download<float>(sums_.slice().elements(0, 12 * joints_)); }

PoseRefinement::PoseRefinement(const Avatar& avatar, std::vector<Pose> starts)
    : skeleton_(avatar.body.skeleton), canonical_(avatar.canonical), starts_(std::move(starts)), numbers_(starts_.size() * count(), 0.0), first_moments_(numbers_), second_moments_(numbers_),
      updates_(starts_.size(), 0) {}

Pose PoseRefinement::pose_of(const std::vector<double>& numbers, std::size_t frame) const {
  Pose pose = starts_[frame];
  const double* at = &numbers[frame * count()];
  for (glm::dvec3& rotation : pose.theta) rotation += glm::dvec3(at[0], at[1], at[2]), at += 3;
  pose.root_position += glm::dvec3(at[0], at[1], at[2]);
  return pose;
}

BoneGradients bone_gradients(const PoseGradients& gradients, std::size_t joints) {
  BoneGradients result{std::vector<glm::dmat4>(joints, glm::dmat4(0.0)), glm::dvec3(0.0)};
  for (std::size_t b = 0; b < joints; ++b) {
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column) result.transforms[b][column][row] = double{gradients.bones[12 * b + static_cast<std::size_t>(4 * row + column)]};
    result.translation += glm::dvec3(result.transforms[b][3]);
  }
  return result;
}

void PoseRefinement::step(std::size_t frame, const PoseGradients& gradients, const GroupSettings& group, double factor) {
  const auto& [bones, translation] = bone_gradients(gradients, skeleton_.size());
  const Pose now = pose(frame);
  std::vector<glm::dvec3> theta = kinematics_gradient(skeleton_, canonical_, now, bones).theta;
  if (!gradients.input.empty())
    for (std::size_t j = 1; j < theta.size(); ++j) {  // of the root the SDF reads nothing
      glm::dmat3 rotation;
      for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) rotation[column][row] = double{gradients.input[9 * j + static_cast<std::size_t>(3 * row + column)]};
      theta[j] += axis_angle_gradient(now.theta[j], rotation);
    }
  std::vector<double> gradient;
  for (const glm::dvec3& g : theta) gradient.insert(gradient.end(), {g.x, g.y, g.z});
  // t = root position − J_0: the root position's gradient is t's.
  gradient.insert(gradient.end(), {translation.x, translation.y, translation.z});

  const std::size_t n = count(), first = frame * n;
  const reference::AdamGroup all{0, n, group.rate * factor, group.weight_decay, group.max_norm};
  const std::vector<double> norm = reference::adam_step(std::span(numbers_).subspan(first, n), gradient, std::span(first_moments_).subspan(first, n), std::span(second_moments_).subspan(first, n),
                                                        std::span(&all, 1), static_cast<int>(updates_[frame] + 1));
  if (!std::isfinite(norm[0])) throw std::runtime_error("the gradient of 'poses' is NaN or infinite");
  updates_[frame] += 1;
}

void PoseRefinement::save(SafetensorsFile& file) const {
  file.tensors["optimizer.pose"] = Tensor::from<double>(shape(), numbers_);
  file.tensors["optimizer.pose_first_moments"] = Tensor::from<double>(shape(), first_moments_);
  file.tensors["optimizer.pose_second_moments"] = Tensor::from<double>(shape(), second_moments_);
  file.tensors["optimizer.pose_updates"] = Tensor::from<int64_t>({static_cast<int64_t>(updates_.size())}, updates_);
}

void PoseRefinement::load(const SafetensorsFile& file) {
  numbers_ = file.values<double>("optimizer.pose", shape());
  first_moments_ = file.values<double>("optimizer.pose_first_moments", shape());
  second_moments_ = file.values<double>("optimizer.pose_second_moments", shape());
  updates_ = file.values<int64_t>("optimizer.pose_updates", {static_cast<int64_t>(updates_.size())});
}

void PoseRefinement::save_poses(SafetensorsFile& file, const std::string& name, const std::vector<Pose>& poses) const {
  std::vector<double> values;
  for (const Pose& pose : poses) {
    for (const glm::dvec3& rotation : pose.theta) values.insert(values.end(), {rotation.x, rotation.y, rotation.z});
    values.insert(values.end(), {pose.root_position.x, pose.root_position.y, pose.root_position.z});
  }
  file.tensors[name] = Tensor::from<double>(shape(), values);
}

std::vector<Pose> PoseRefinement::load_poses(const SafetensorsFile& file, const std::string& name) const {
  const std::vector<double> values = file.values<double>(name, shape());
  std::vector<Pose> poses;
  for (auto at = values.begin(); at != values.end();) {
    Pose pose;
    for (std::size_t j = 0; j < skeleton_.size(); ++j, at += 3) pose.theta.emplace_back(at[0], at[1], at[2]);
    pose.root_position = {at[0], at[1], at[2]};
    at += 3;
    poses.push_back(std::move(pose));
  }
  return poses;
}

Pose disturbed_pose(const Pose& pose, double degrees, double metres, uint64_t seed, int frame) {
  std::seed_seq sequence{uint32_t(seed), uint32_t(seed >> 32), uint32_t(frame), 0x706f7365u};  // "pose": a stream of its own
  std::mt19937_64 generator(sequence);
  std::normal_distribution<double> normal;
  const auto vector = [&] {
    const double x = normal(generator), y = normal(generator), z = normal(generator);
    return glm::dvec3(x, y, z);
  };
  Pose result = pose;
  for (glm::dvec3& rotation : result.theta) {
    const glm::dvec3 axis = glm::normalize(vector());
    const double angle = normal(generator) * degrees * std::numbers::pi / 180;
    rotation = axis_angle_from_rotation(rotation_from_axis_angle(axis * angle) * rotation_from_axis_angle(rotation));
  }
  result.root_position += metres * vector();
  return result;
}

}  // namespace arah
