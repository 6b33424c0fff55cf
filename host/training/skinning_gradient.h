// What the skinning network learns from: the colours, through the implicit gradient of the correspondence (paper, App.
// "Implicit Gradients"), and the template's weights on its surface (ARAH.md §7).
#pragma once

#include <random>

#include "host/rendering/avatar_networks.h"
#include "host/rendering/frame_on_device.h"
#include "host/training/pose_refinement.h"
#include "host/training/template_samples.h"
#include "kernels/skinning/lbs_backward.h"
#include "kernels/skinning/weights_loss.h"

namespace arah {

class SkinningGradient {
 public:
  // rows: samples of a step; points: of the template's surface. counts: shared::ImplicitCounts of record_from_positions, +=; empty
  // where only surface losses are wanted. scratch_floats: of partial sums, shared with others.
  SkinningGradient(Device& device, AvatarNetworks& networks, uint32_t rows, uint32_t points, const BufferSlice& counts = {});
  uint64_t scratch_floats() const;

  // dL/dx̂ (upstream, vec4 by row, per metre) at the roots (canonical, w = 1) → effective weight gradients (=, or += with
  // accumulate), and the pose's gradient (+=), each where wanted. Skinning::backward: the posed points of the rows are
  // targets[samples].
  struct Wanted {
    bool weights = true;
    PoseGradient* pose = nullptr;
    BufferSlice targets = {}, samples = {};
  };
  void record_from_positions(Commands& commands, FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical, const BufferSlice& upstream, bool accumulate, const BufferSlice& scratch,
                             const Wanted& wanted);
  void record_from_positions(Commands& commands, FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical, const BufferSlice& upstream, bool accumulate, const BufferSlice& scratch) {
    record_from_positions(commands, frame, rows, canonical, upstream, accumulate, scratch, Wanted{});
  }

  // The two halves of the above around another use of the Jacobians: ∂LBS/∂x̂ at canonical points, three vec4 by row; and from
  // cotangents on LBS(x̂) at these points, vec4 by row, to effective weight gradients.
  void record_jacobians(Commands& commands, FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical) { record_jacobians(commands, frame, rows, canonical, Wanted{}); }
  BufferSlice jacobians() { return jacobians_.slice(); }
  void record_from_cotangents(Commands& commands, FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical, const BufferSlice& cotangents, bool accumulate, const BufferSlice& scratch);

  // Uploads a batch of `points` of the pool, with Skinning::backward moved by these bones; then the loss and its effective weight gradients (=, or += with accumulate).
  // passed_over: points that are drawn before them, and left to others.
  void set_surface(const std::vector<WeightSample>& pool, std::mt19937_64& generator, const std::vector<glm::dmat4>& bones, uint32_t passed_over = 0);
  void record_surface_loss(Commands& commands, const BufferSlice& frame_constants, WeightsMeasure measure, double weight, bool accumulate, const BufferSlice& losses, uint32_t slot, const BufferSlice& scratch);

 private:
  bool asks_posed_points() const { return networks_.spec().skinning.kind == Skinning::backward; }
  LbsBackwardArgs backward(FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical);
  void record_jacobians(Commands& commands, FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical, const Wanted& wanted);

  Device& device_;
  AvatarNetworks& networks_;
  uint32_t points_;
  BufferSlice counts_;
  DenseTape rows_tape_, points_tape_;
  Buffer posed_, transforms_, jacobians_, cotangents_, gradients_[3], surface_, target_joints_, target_weights_, loss_scratch_;
};

}  // namespace arah
