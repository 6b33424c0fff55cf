// Corrections of the training frames' poses (paper, appendix "Pose and Shape Optimization"): what the loss says about the bone
// transforms, and the steps that follow from it.
#pragma once

#include <random>
#include <span>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/rendering/avatar_networks.h"
#include "host/rendering/frame_on_device.h"
#include "host/rendering/root_finder.h"
#include "host/training/training_settings.h"

namespace arah {

// dL/dB of a step, added up on the device over its passes.
class PoseGradient {
 public:
  // rows: roots of a pass. counts: shared::ImplicitCounts of record_add_by_vertex, +=.
  PoseGradient(Device& device, AvatarNetworks& networks, uint32_t rows, const BufferSlice& counts);

  void record_clear(Commands& commands);
  // Room for the skinning network's weights by row, for record_lbs; then with the cotangents on LBS(x̂) at the roots, vec4 by row:
  Matrix weights() { return {weights_.slice(), stride_, 0}; }
  void record_add(Commands& commands, uint32_t rows, const BufferSlice& canonical, const BufferSlice& cotangents);
  // With template weights: from dL/dx̂ (upstream, vec4 by row, per metre). A vertex's weights are the same all over its part of
  // space, so the Jacobian is the blend of bones itself. rows: as record_transforms of `finder` takes them.
  void record_add_by_vertex(Commands& commands, FrameOnDevice& frame, PointRootFinder& finder, const Rows& rows, const BufferSlice& canonical, const BufferSlice& upstream);
  std::vector<float> download();  // [J][3][4], after submission

 private:
  Device& device_;
  uint32_t joints_, stride_;
  BufferSlice counts_;
  Buffer weights_, cotangents_, partials_, sums_;
};

// What a step's loss says about a frame's pose.
struct PoseGradients {
  std::vector<float> bones;  // dL/dB: PoseGradient::download()
  std::vector<float> input;  // dL/d(what a pose-conditioned SDF reads), laid out as pose_input(); empty without one
};

// The same of the bones alone, as matrices (last rows 0), and dL/dt of the root translation, the sum of the last columns
// (kernels/skinning/bone_gradient.h).
struct BoneGradients {
  std::vector<glm::dmat4> transforms;  // [J]
  glm::dvec3 translation{0.0};
};
BoneGradients bone_gradients(const PoseGradients& gradients, std::size_t joints);

// The poses as they are now, and Adam's state. A frame's numbers: how far its rotations [J][3] (axis-angles) and its root position
// are from where they began, so that weight decay draws them back there.
class PoseRefinement {
 public:
  PoseRefinement(const Avatar& avatar, std::vector<Pose> starts);

  const std::vector<Pose>& starts() const { return starts_; }
  Pose pose(std::size_t frame) const { return pose_of(numbers_, frame); }
  // Where the body's shape has moved its joints.
  void set_skeleton(const Skeleton& skeleton) { skeleton_ = skeleton; }
  // One step of Adam (β 0.9, 0.999), in double precision, for the frame whose pictures the step saw; other frames stay as they are,
  // moments and all. factor: of the group's rate. Throws std::runtime_error, and leaves
  // the pose as it is, where the gradient is not finite.
  void step(std::size_t frame, const PoseGradients& gradients, const GroupSettings& group, double factor);

  // "optimizer.pose*" tensors; reading throws InputError naming what does not fit.
  void save(SafetensorsFile& file) const;
  void load(const SafetensorsFile& file);
  // Poses as such numbers, in a tensor of their own.
  void save_poses(SafetensorsFile& file, const std::string& name, const std::vector<Pose>& poses) const;
  std::vector<Pose> load_poses(const SafetensorsFile& file, const std::string& name) const;

 private:
  std::size_t count() const { return 3 * skeleton_.size() + 3; }  // numbers of a frame
  std::vector<int64_t> shape() const { return {static_cast<int64_t>(starts_.size()), static_cast<int64_t>(count())}; }
  Pose pose_of(const std::vector<double>& numbers, std::size_t frame) const;

  Skeleton skeleton_;
  CanonicalPose canonical_;
  std::vector<Pose> starts_;
  std::vector<double> numbers_, first_moments_, second_moments_;  // [frames][count()]
  std::vector<int64_t> updates_;                                  // by frame: Adam's t
};

// The pose with every rotation turned about a random axis by an angle of the normal distribution N(0, degrees), and the root
// moved by N(0, metres) along each axis: for studies of refinement. The same for the same seed and frame number.
Pose disturbed_pose(const Pose& pose, double degrees, double metres, uint64_t seed, int frame);

}  // namespace arah
