#include "kernels/losses/sdf_penalty.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/reduction/sum.h"
#include "shaders/shared/losses.h"

namespace arah {
namespace {

struct PenaltyNames {
  const char* name;
  const char* sum;
};

PenaltyNames names_of(SdfPenalty penalty) {
  switch (penalty) {
    case SdfPenalty::off_surface: break;
    case SdfPenalty::inside: return {"loss inside the body", "sum of the loss inside the body"};
    case SdfPenalty::on_surface: return {"loss on the surface", "sum of the loss on the surface"};
    case SdfPenalty::near_zero: return {"loss of small distances", "sum of the loss of small distances"};
  }
  return {"loss off the surface", "sum of the loss off the surface"};
}

}  // namespace

void record_sdf_penalty(Commands& commands, const SdfPenaltyArgs& args) {
  if (args.d_sdf.stride % 4 || args.d_sdf.column % 4 || args.d_sdf_columns % 4)
    throw std::invalid_argument(
        fmt::format("sdf penalty: gradient of stride {}, column {}, width {}, multiples of 4 expected",
                    args.d_sdf.stride, args.d_sdf.column, args.d_sdf_columns));
  const shared::SdfPenaltyConstants constants{args.points,     1 / args.normaliser, args.weight,      args.sdf.stride,
                                              args.sdf.column, args.d_sdf.stride,   args.d_sdf.column};
  const PenaltyNames names = names_of(args.penalty);
  const uint32_t padded = padded_points(args.points);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("losses/sdf_penalty", {static_cast<uint32_t>(args.penalty), args.d_sdf_columns / 4});
  launch.name = names.name;
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.sdf.slice, uint64_t(args.points) * args.sdf.stride * 4},
                     {args.d_sdf.slice, uint64_t(padded) * args.d_sdf.stride * 4},
                     {args.partials, partial_bytes(args.points)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {args.points * 30.0, args.points * (4.0 + 4.0 * args.d_sdf_columns)};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = names.sum;
  sum.rows = padded / point_padding;
  sum.partials = args.partials;
  sum.sums = args.losses;
  sum.sum_index = args.slot;
  record_sum(commands, sum);
}

}  // namespace arah
