#include "kernels/losses/eikonal.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/reduction/sum.h"
#include "shaders/shared/losses.h"

namespace arah {

void record_eikonal_loss(Commands& commands, const EikonalLossArgs& args) {
  for (const uint32_t number :
       {args.gradients.stride, args.gradients.column, args.d_gradients.stride, args.d_gradients.column, args.d_columns})
    if (number % 4)
      throw std::invalid_argument(
          fmt::format("eikonal loss: a stride, column or width is {}, multiples of 4 expected", number));
  const shared::EikonalConstants constants{args.points,
                                           1 / args.normaliser,
                                           args.weight,
                                           args.gradients.stride / 4,
                                           args.gradients.column / 4,
                                           args.d_gradients.stride / 4,
                                           args.d_gradients.column / 4,
                                           args.d_columns / 4};
  const uint32_t padded = padded_points(args.points);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("losses/eikonal");
  launch.name = "eikonal loss";
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.gradients.slice, uint64_t(args.points) * args.gradients.stride * 4},
                     {args.d_gradients.slice, uint64_t(padded) * args.d_gradients.stride * 4},
                     {args.partials, partial_bytes(args.points)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {args.points * 15.0, args.points * (16.0 + 4.0 * args.d_columns)};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = "sum of the eikonal loss";
  sum.rows = padded / point_padding;
  sum.partials = args.partials;
  sum.sums = args.losses;
  sum.sum_index = args.slot;
  record_sum(commands, sum);
}

}  // namespace arah
