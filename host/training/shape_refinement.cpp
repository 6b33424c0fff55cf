#include "host/training/shape_refinement.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <random>
#include <stdexcept>

#include "host/body/kinematics_gradient.h"
#include "host/input_error.h"
#include "kernels/reference/adam.h"

namespace arah {

std::vector<double> shape_gradient(const Avatar& avatar, const Pose& pose, const PoseGradients& gradients) {
  const Skeleton& skeleton = avatar.body.skeleton;
  const BoneGradients bones = bone_gradients(gradients, skeleton.size());
  std::vector<glm::dvec3> joints = kinematics_gradient(skeleton, avatar.canonical, pose, bones.transforms, {}, true).rest_joints;
  joints[0] -= bones.translation;
  if (!gradients.input.empty())  // pose_input(): the joints in the cube come after the rotations
    for (std::size_t j = 0; j < joints.size(); ++j)
      for (int axis = 0; axis < 3; ++axis) joints[j][axis] += double{gradients.input[9 * joints.size() + 3 * j + static_cast<std::size_t>(axis)]} / avatar.cube.metres_per_unit();
  std::vector<double> result;
  for (const std::vector<glm::dvec3>& offsets : avatar.body.shape.joint_offsets) {
    double sum = 0;
    for (std::size_t j = 0; j < joints.size(); ++j) sum += glm::dot(offsets[j], joints[j]);
    result.push_back(sum);
  }
  return result;
}

ShapeRefinement::ShapeRefinement(std::vector<double> start) : start_(std::move(start)), numbers_(start_.size(), 0.0), first_moments_(numbers_), second_moments_(numbers_) {}

std::vector<double> ShapeRefinement::beta() const {
  std::vector<double> beta = start_;
  for (std::size_t b = 0; b < beta.size(); ++b) beta[b] += numbers_[b];
  return beta;
}

void ShapeRefinement::step(const std::vector<double>& gradient, const GroupSettings& group, double factor) {
  const reference::AdamGroup all{0, numbers_.size(), group.rate * factor, group.weight_decay, group.max_norm};
  const std::vector<double> norm = reference::adam_step(numbers_, gradient, first_moments_, second_moments_, std::span(&all, 1), static_cast<int>(updates_ + 1));
  if (!std::isfinite(norm[0])) throw std::runtime_error("the gradient of 'shape' is NaN or infinite");
  updates_ += 1;
}

void ShapeRefinement::save(SafetensorsFile& file) const {
  const auto put = [&](const char* name, const std::vector<double>& values) { file.tensors[name] = Tensor::from<double>({static_cast<int64_t>(values.size())}, values); };
  put("optimizer.shape", numbers_);
  put("optimizer.shape_first_moments", first_moments_);
  put("optimizer.shape_second_moments", second_moments_);
  file.tensors["optimizer.shape_updates"] = Tensor::from<int64_t>({}, std::vector<int64_t>{updates_});
}

void ShapeRefinement::load(const SafetensorsFile& file) {
  const std::vector<int64_t> size{static_cast<int64_t>(start_.size())};
  numbers_ = file.values<double>("optimizer.shape", size);
  first_moments_ = file.values<double>("optimizer.shape_first_moments", size);
  second_moments_ = file.values<double>("optimizer.shape_second_moments", size);
  updates_ = file.values<int64_t>("optimizer.shape_updates", {})[0];
}

std::vector<double> disturbed_shape(const std::vector<double>& beta, double deviation, uint64_t seed) {
  std::seed_seq sequence{uint32_t(seed), uint32_t(seed >> 32), 0x73686170u};  // "shap": a stream of its own
  std::mt19937_64 generator(sequence);
  std::normal_distribution<double> normal(0, 1);
  std::vector<double> result = beta;
  for (double& value : result) value += deviation * normal(generator);
  return result;
}

}  // namespace arah
