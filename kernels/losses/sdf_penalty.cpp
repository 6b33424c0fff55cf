#include "kernels/losses/sdf_penalty.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/reduction/sum.h"
#include "shaders/shared/losses.h"

namespace arah {

void record_sdf_penalty(Commands& commands, const SdfPenaltyArgs& args) {
  if (args.d_sdf.stride % 4 || args.d_sdf.column % 4 || args.d_sdf_columns % 4)
    throw std::invalid_argument(
        fmt::format("sdf penalty: gradient of stride {}, column {}, width {}, multiples of 4 expected",
                    args.d_sdf.stride, args.d_sdf.column, args.d_sdf_columns));
  const shared::SdfPenaltyConstants constants{args.points,     1 / args.normaliser, args.weight,      args.sdf.stride,
                                              args.sdf.column, args.d_sdf.stride,   args.d_sdf.column};
  const bool inside = args.penalty == SdfPenalty::inside;
  const uint32_t padded = padded_points(args.points);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("losses/sdf_penalty", {inside ? 1u : 0u, args.d_sdf_columns / 4});
  launch.name = inside ? "loss inside the body" : "loss off the surface";
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.sdf.slice, uint64_t(args.points) * args.sdf.stride * 4},
                     {args.d_sdf.slice, uint64_t(padded) * args.d_sdf.stride * 4},
                     {args.partials, partial_bytes(args.points)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {args.points * 30.0, args.points * (4.0 + 4.0 * args.d_sdf_columns)};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = inside ? "sum of the loss inside the body" : "sum of the loss off the surface";
  sum.rows = padded / point_padding;
  sum.partials = args.partials;
  sum.sums = args.losses;
  sum.sum_index = args.slot;
  record_sum(commands, sum);
}

}  // namespace arah
