#include "host/training/skinning_gradient.h"

#include <algorithm>

#include "kernels/reduction/sum.h"
#include "kernels/skinning/implicit_cotangent.h"
#include "kernels/skinning/jacobian.h"
#include "kernels/skinning/lbs.h"
#include "kernels/tracing/normalise_inputs.h"

namespace arah {

SkinningGradient::SkinningGradient(Device& device, AvatarNetworks& networks, uint32_t rows, uint32_t points, const BufferSlice& counts)
    : device_(device), networks_(networks), points_(points), counts_(counts), rows_tape_(device, "skinning of samples", networks.skinning_shape(), rows, true),
      points_tape_(device, "skinning of surface points", networks.skinning_shape(), points, true) {
  const uint64_t r = padded_points(rows), p = padded_points(points);
  auto make = [&](const char* what, uint64_t bytes) { return Buffer(device, std::string("skinning gradient: ") + what, bytes, BufferPlace::device); };
  posed_ = make("posed points", r * 16);
  transforms_ = make("transforms", r * 48);
  jacobians_ = make("Jacobians", r * 48);
  cotangents_ = make("cotangents", r * 16);
  for (Buffer& gradient : gradients_) gradient = make("row of the Jacobian", r * channel_padding * 4);
  surface_ = make("surface points", p * 16);
  target_joints_ = make("target joints", p * 4);
  target_weights_ = make("target weights", p * 16);
  loss_scratch_ = make("partial losses", partial_bytes(points));
}

uint64_t SkinningGradient::scratch_floats() const {
  return std::max(networks_.skinning().weight_gradient_scratch(rows_tape_.capacity()), networks_.skinning().weight_gradient_scratch(points_tape_.capacity()));
}

void SkinningGradient::record_from_positions(Commands& commands, FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical, const BufferSlice& upstream, bool accumulate, const BufferSlice& scratch,
                                             const Wanted& wanted) {
  record_jacobians(commands, frame, rows, canonical, wanted);
  record_implicit_cotangent(commands, {rows, asks_posed_points() ? transforms_.slice() : jacobians_.slice(), upstream, canonical, cotangents_.slice(), counts_});
  if (wanted.pose) wanted.pose->record_add(commands, rows, canonical, cotangents_.slice());
  if (wanted.weights) record_from_cotangents(commands, frame, rows, canonical, cotangents_.slice(), accumulate, scratch);
}

LbsBackwardArgs SkinningGradient::backward(FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical) {
  LbsBackwardArgs back;
  back.tree = &networks_.tree();
  back.rows = {{rows, {}}, {}};
  back.logits = rows_tape_.output();
  back.frame = frame.constants();
  back.canonical = canonical;
  back.d_logits = rows_tape_.output_gradient();
  return back;
}

void SkinningGradient::record_jacobians(Commands& commands, FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical, const Wanted& wanted) {
  const Rows all{{rows, {}}, {}};
  DenseNetwork& network = networks_.skinning();
  if (asks_posed_points()) record_normalise_inputs(commands, {{all.range, wanted.samples}, frame.constants(), wanted.targets, rows_tape_.input(), true});
  else record_normalise_inputs(commands, {all, frame.constants(), canonical, rows_tape_.input()});
  network.record_forward(commands, rows_tape_, all.range);
  LbsArgs lbs;
  lbs.tree = &networks_.tree();
  lbs.rows = all;
  lbs.logits = rows_tape_.output();
  lbs.frame = frame.constants();
  lbs.canonical = canonical;
  lbs.posed = posed_.slice();
  lbs.transforms = transforms_.slice();
  if (wanted.pose) lbs.weights = wanted.pose->weights();
  record_lbs(commands, lbs);

  LbsBackwardArgs back = backward(frame, rows, canonical);
  JacobianArgs jacobian;
  jacobian.range = all.range;
  jacobian.frame = frame.constants();
  jacobian.transforms = transforms_.slice();
  jacobian.jacobians = jacobians_.slice();
  // Weights that are given at the posed point do not change with x̂: what the search's Jacobian is otherwise, T is alone.
  for (uint32_t i = 0; i < (asks_posed_points() ? 0u : 3u); ++i) {
    back.component = i;
    record_lbs_backward(commands, back);
    DenseNetwork::Backward through;
    through.weight_gradients = false;
    through.input_gradient = true;
    through.input_gradient_result = {gradients_[i].slice(), channel_padding, 0};
    network.record_backward(commands, rows_tape_, all.range, through);
    jacobian.gradients[i] = through.input_gradient_result;
  }
  if (!asks_posed_points()) record_jacobian(commands, jacobian);
}

void SkinningGradient::record_from_cotangents(Commands& commands, FrameOnDevice& frame, uint32_t rows, const BufferSlice& canonical, const BufferSlice& cotangents, bool accumulate, const BufferSlice& scratch) {
  LbsBackwardArgs back = backward(frame, rows, canonical);
  back.component = 3;
  back.cotangents = cotangents;
  record_lbs_backward(commands, back);
  DenseNetwork::Backward weights;
  weights.accumulate = accumulate;
  weights.scratch = scratch;
  networks_.skinning().record_backward(commands, rows_tape_, {rows, {}}, weights);
}

void SkinningGradient::set_surface(const std::vector<WeightSample>& pool, std::mt19937_64& generator, const std::vector<glm::dmat4>& bones, uint32_t passed_over) {
  std::uniform_int_distribution<size_t> pick(0, pool.size() - 1);
  for (uint32_t i = 0; i < passed_over; ++i) pick(generator);
  std::vector<std::array<float, 4>> positions, weights;
  std::vector<uint32_t> joints;
  for (uint32_t i = 0; i < points_; ++i) {
    const WeightSample& s = pool[pick(generator)];
    glm::vec3 at = s.position;
    if (asks_posed_points()) {
      glm::dvec4 moved(0);
      for (int k = 0; k < 4; ++k) moved += double{s.weights[k]} * (bones.at(s.joints[static_cast<size_t>(k)]) * glm::dvec4(glm::dvec3(s.position), 1));
      at = glm::vec3(moved);
    }
    positions.push_back({at.x, at.y, at.z, 1});
    weights.push_back({s.weights.x, s.weights.y, s.weights.z, s.weights.w});
    joints.push_back(uint32_t(s.joints[0]) | uint32_t(s.joints[1]) << 8 | uint32_t(s.joints[2]) << 16 | uint32_t(s.joints[3]) << 24);
  }
  device_.upload(surface_.slice(), positions);
  device_.upload(target_weights_.slice(), weights);
  device_.upload(target_joints_.slice(), joints);
}

void SkinningGradient::record_surface_loss(Commands& commands, const BufferSlice& frame_constants, WeightsMeasure measure, double weight, bool accumulate, const BufferSlice& losses, uint32_t slot,
                                           const BufferSlice& scratch) {
  const PointRange range{points_, {}};
  record_normalise_inputs(commands, {{range, {}}, frame_constants, surface_.slice(), points_tape_.input(), asks_posed_points()});
  networks_.skinning().record_forward(commands, points_tape_, range);
  WeightsLossArgs loss;
  loss.tree = &networks_.tree();
  loss.measure = measure;
  loss.points = points_;
  loss.logits = points_tape_.output();
  loss.target_joints = target_joints_.slice();
  loss.target_weights = target_weights_.slice();
  loss.weight = static_cast<float>(weight);
  loss.d_logits = points_tape_.output_gradient();
  loss.scratch = loss_scratch_.slice();
  loss.losses = losses;
  loss.slot = slot;
  record_weights_loss(commands, loss);
  DenseNetwork::Backward backward;
  backward.accumulate = accumulate;
  backward.scratch = scratch;
  networks_.skinning().record_backward(commands, points_tape_, range, backward);
}

}  // namespace arah
