#include "kernels/conditioning/low_rank.h"

#include "kernels/linear/matrix.h"
#include "kernels/reduction/sum.h"
#include "shaders/shared/conditioning.h"

namespace arah {
namespace {

uint64_t texel_bytes(uint64_t floats) { return (floats + 3) / 4 * 16; }
uint32_t groups_of(uint64_t invocations) { return static_cast<uint32_t>((invocations + point_padding - 1) / point_padding); }

}  // namespace

void record_low_rank(Commands& commands, const LowRankArgs& args) {
  const shared::LowRankConstants constants{args.outputs, args.inputs, args.rank, args.first_h};
  const uint64_t numbers = uint64_t(args.outputs) * args.inputs, of_outputs = uint64_t(args.outputs) * args.rank;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("conditioning/low_rank");
  launch.name = "low-rank change of the sdf's layer";
  launch.groups = {groups_of(numbers + args.outputs), 1, 1};
  launch.bindings = {{args.tensors.u, texel_bytes(of_outputs)}, {args.tensors.v, texel_bytes(uint64_t(args.rank) * args.inputs)}, {args.tensors.c, texel_bytes(of_outputs)},
                     {args.h, (args.first_h + args.rank) * 4ull}, {args.base_w, numbers * 4}, {args.base_b, args.outputs * 4ull}, {args.w, numbers * 4}, {args.b, args.outputs * 4ull}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {3.0 * double(numbers) * args.rank, 8.0 * double(numbers) + 8.0 * double(of_outputs)};
  commands.dispatch(launch);
}

void record_low_rank_backward(Commands& commands, const LowRankBackwardArgs& args) {
  const LowRankArgs& forward = args.forward;
  const shared::LowRankConstants constants{forward.outputs, forward.inputs, forward.rank, forward.first_h};
  const uint64_t numbers = uint64_t(forward.outputs) * forward.inputs, of_outputs = uint64_t(forward.outputs) * forward.rank, of_inputs = uint64_t(forward.rank) * forward.inputs;
  const uint64_t h_bytes = (forward.first_h + forward.rank) * 4ull;
  Launch launch;
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.pipeline = &commands.device().pipeline("conditioning/low_rank_backward_outputs");
  launch.name = "low-rank change: backward to its outputs";
  launch.groups = {groups_of(of_outputs), 1, 1};
  launch.bindings = {{args.d_w, texel_bytes(numbers)}, {forward.tensors.v, texel_bytes(of_inputs)}, {args.d_b, forward.outputs * 4ull}, {forward.tensors.u, of_outputs * 4}, {forward.tensors.c, of_outputs * 4},
                     {forward.h, h_bytes}, {args.gradients.u, of_outputs * 4}, {args.gradients.c, of_outputs * 4}, {args.partials, of_outputs * 4}};
  launch.cost = {2.0 * double(of_outputs) * forward.inputs, 4.0 * double(numbers) + 28.0 * double(of_outputs)};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = "sum of the coefficients' gradient";
  sum.rows = forward.outputs;
  sum.columns = forward.rank;
  sum.partials = args.partials;
  sum.sums = args.d_h;
  sum.sum_index = forward.first_h;
  record_sum(commands, sum);

  launch.pipeline = &commands.device().pipeline("conditioning/low_rank_backward_inputs");
  launch.name = "low-rank change: backward to its inputs";
  launch.groups = {groups_of(of_inputs), 1, 1};
  launch.bindings = {{args.d_w, texel_bytes(numbers)}, {forward.tensors.u, texel_bytes(of_outputs)}, {forward.h, h_bytes}, {args.gradients.v, of_inputs * 4}};
  launch.cost = {2.0 * double(of_inputs) * forward.outputs, 4.0 * double(numbers) + 8.0 * double(of_inputs)};
  commands.dispatch(launch);
}

}  // namespace arah
