#include "kernels/losses/mask.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/reduction/sum.h"
#include "shaders/shared/losses.h"

namespace arah {

void record_mask_loss(Commands& commands, const MaskLossArgs& args) {
  for (const uint32_t number : {args.sdf.stride, args.sdf.column, args.d_sdf.stride, args.d_sdf.column, args.d_sdf_columns})
    if (number % 4) throw std::invalid_argument(fmt::format("mask loss: a stride, column or width of {}, multiples of 4 expected", number));
  const shared::MaskLossConstants constants{args.rays,           1 / args.normaliser, args.weight,           args.alpha,
                                            args.sdf.stride / 4, args.sdf.column / 4, args.d_sdf.stride / 4, args.d_sdf.column / 4};
  const uint32_t padded = padded_points(args.rays);
  const bool weighted = !args.weights.empty();
  Launch launch;
  launch.pipeline = &commands.device().pipeline("losses/mask", {weighted ? 1u : 0u, args.d_sdf_columns / 4});
  launch.name = "mask loss of least distances";
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.sdf.slice, uint64_t(args.rays) * args.sdf.stride * 4},
                     {args.points, uint64_t(args.rays) * 16},
                     {args.masks, uint64_t(args.rays) * 4},
                     {args.d_sdf.slice, uint64_t(padded) * args.d_sdf.stride * 4},
                     {args.partials, partial_bytes(args.rays, 2)},
                     // What is not used needs a buffer all the same.
                     weighted ? Binding(args.weights, uint64_t(args.rays) * 4) : Binding(args.masks)};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {args.rays * 60.0, args.rays * (28.0 + 4.0 * args.d_sdf_columns)};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = "sums of the mask loss";
  sum.rows = padded / point_padding;
  sum.columns = 2;
  sum.partials = args.partials;
  sum.sums = args.losses;
  sum.sum_index = args.slot;
  record_sum(commands, sum);
}

}  // namespace arah
