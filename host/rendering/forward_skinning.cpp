#include "host/rendering/forward_skinning.h"

#include "kernels/skinning/jacobian.h"
#include "kernels/skinning/lbs.h"
#include "kernels/skinning/lbs_backward.h"
#include "kernels/tracing/normalise_inputs.h"

namespace arah {

ForwardSkinning::ForwardSkinning(Device& device, AvatarNetworks& networks, uint32_t capacity, const std::string& name) : networks_(networks), tape_(device, name + ": skinning", networks.skinning_shape(), capacity, true) {
  const auto make = [&](const char* what, uint64_t bytes) { return Buffer(device, name + ": " + what, bytes, BufferPlace::device); };
  posed_ = make("skinned points", capacity * 16ull);
  transforms_ = make("transforms", capacity * 48ull);
  jacobians_ = make("Jacobians", capacity * 48ull);
  for (Buffer& gradient : gradients_) gradient = make("row of the Jacobian", uint64_t(capacity) * channel_padding * 4);
}

void ForwardSkinning::record(Commands& commands, FrameOnDevice& frame, const Rows& rows, const BufferSlice& at, bool jacobian) {
  DenseNetwork& network = networks_.skinning();
  record_normalise_inputs(commands, {rows, frame.constants(), at, tape_.input()});
  network.record_forward(commands, tape_, rows.range);
  LbsArgs lbs;
  lbs.tree = &networks_.tree();
  lbs.rows = rows;
  lbs.logits = tape_.output();
  lbs.frame = frame.constants();
  lbs.canonical = at;
  lbs.posed = posed_.slice();
  if (jacobian) lbs.transforms = transforms_.slice();
  record_lbs(commands, lbs);
  if (!jacobian) return;

  LbsBackwardArgs back;
  back.tree = lbs.tree;
  back.rows = rows;
  back.logits = lbs.logits;
  back.frame = lbs.frame;
  back.canonical = at;
  back.d_logits = tape_.output_gradient();
  JacobianArgs result;
  result.range = rows.range;
  result.frame = lbs.frame;
  result.transforms = transforms_.slice();
  result.jacobians = jacobians_.slice();
  for (uint32_t i = 0; i < 3; ++i) {
    back.component = i;
    record_lbs_backward(commands, back);
    DenseNetwork::Backward through;
    through.weight_gradients = false;
    through.input_gradient = true;
    through.input_gradient_result = {gradients_[i].slice(), channel_padding, 0};
    network.record_backward(commands, tape_, rows.range, through);
    result.gradients[i] = through.input_gradient_result;
  }
  record_jacobian(commands, result);
}

}  // namespace arah
