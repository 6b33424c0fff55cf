#include "kernels/conditioning/layer_norm.h"

#include "shaders/shared/conditioning.h"

namespace arah {

void record_layer_norm(Commands& commands, const LayerNormArgs& args) {
  const shared::LayerNormConstants constants{args.size};
  const uint64_t bytes = uint64_t(args.blocks) * args.size * 4;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("conditioning/layer_norm");
  launch.name = "layer norm";
  launch.groups = {args.blocks, 1, 1};
  launch.bindings = {{args.a, bytes}, {args.scale, bytes}, {args.shift, bytes}, {args.normalised, bytes}, {args.inverse_deviation, args.blocks * 4ull}, {args.y, bytes}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {2.0 * double(bytes), 5.0 * double(bytes)};
  commands.dispatch(launch);
}

void record_layer_norm_backward(Commands& commands, const LayerNormBackwardArgs& args) {
  const LayerNormArgs& forward = args.forward;
  const shared::LayerNormConstants constants{forward.size};
  const uint64_t bytes = uint64_t(forward.blocks) * forward.size * 4;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("conditioning/layer_norm_backward");
  launch.name = "layer norm: backward";
  launch.groups = {forward.blocks, 1, 1};
  launch.bindings = {{args.d_y, bytes}, {forward.y, bytes}, {forward.normalised, bytes}, {forward.inverse_deviation, forward.blocks * 4ull},
                     {forward.scale, bytes}, {args.d_scale, bytes}, {args.d_shift, bytes}, {args.d_a, bytes}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {3.0 * double(bytes), 9.0 * double(bytes)};
  commands.dispatch(launch);
}

}  // namespace arah
