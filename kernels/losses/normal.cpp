#include "kernels/losses/normal.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/reduction/sum.h"
#include "shaders/shared/losses.h"

namespace arah {

void record_normal_loss(Commands& commands, const NormalLossArgs& args) {
  for (const uint32_t number : {args.gradients.stride, args.gradients.column, args.d_gradients.stride, args.d_gradients.column})
    if (number % 4) throw std::invalid_argument(fmt::format("normal loss: a stride or column is {}, multiples of 4 expected", number));
  const shared::NormalLossConstants constants{args.points,
                                              1 / args.normaliser,
                                              args.weight,
                                              args.gradients.stride / 4,
                                              args.gradients.column / 4,
                                              args.d_gradients.stride / 4,
                                              args.d_gradients.column / 4};
  const uint32_t groups = padded_points(args.points) / point_padding;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("losses/normal");
  launch.name = "loss of normals";
  launch.groups = {groups, 1, 1};
  launch.bindings = {{args.gradients.slice, uint64_t(args.points) * args.gradients.stride * 4},
                     {args.normals, uint64_t(args.points) * 16},
                     {args.d_gradients.slice, uint64_t(args.points) * args.d_gradients.stride * 4},
                     {args.partials, partial_bytes(args.points)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {args.points * 30.0, args.points * 64.0};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = "sum of the loss of normals";
  sum.rows = groups;
  sum.partials = args.partials;
  sum.sums = args.losses;
  sum.sum_index = args.slot;
  record_sum(commands, sum);
}

}  // namespace arah
