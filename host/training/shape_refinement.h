// Correction of the body's shape in training (paper, appendix "Pose and Shape Optimization"): one β for all frames, which
// moves the joints that poses turn about, from what the loss says about the frames' bone transforms.
#pragma once

#include <vector>

#include "host/avatar/avatar.h"
#include "host/training/pose_refinement.h"

namespace arah {

// dL/dβ of a frame in the body's present shape: Σ_j offset of joint j · dL/dJ_j. J enters through the bone transforms
// B_b = A_b V_b⁻¹ (V stays: Avatar::canonical), the root translation t = root position − J_0, and what a pose-conditioned SDF
// reads of the rest joints. The template's vertices do not enter: samples of a ray stay where they are. [B]
std::vector<double> shape_gradient(const Avatar& avatar, const Pose& pose, const PoseGradients& gradients);

// β as it is now, and Adam's state. Its numbers are how far β is from where it began, so that weight decay draws it back there.
class ShapeRefinement {
 public:
  explicit ShapeRefinement(std::vector<double> start);

  const std::vector<double>& start() const { return start_; }
  std::vector<double> beta() const;
  // One step of Adam (β 0.9, 0.999), in double precision. factor: of the group's rate. Throws std::runtime_error, and leaves β
  // as it is, where the gradient is not finite.
  void step(const std::vector<double>& gradient, const GroupSettings& group, double factor);

  // "optimizer.shape*" tensors; reading throws InputError naming what does not fit.
  void save(SafetensorsFile& file) const;
  void load(const SafetensorsFile& file);

 private:
  std::vector<double> start_, numbers_, first_moments_, second_moments_;
  int64_t updates_ = 0;  // Adam's t
};

// β with each number moved by the normal distribution N(0, deviation): for studies of refinement. The same for the same seed.
std::vector<double> disturbed_shape(const std::vector<double>& beta, double deviation, uint64_t seed);

}  // namespace arah
