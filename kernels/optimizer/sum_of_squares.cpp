#include "kernels/optimizer/sum_of_squares.h"

#include <algorithm>

#include "kernels/optimizer/chunks.h"

namespace arah {

void record_sum_of_squares(Commands& commands, const SumOfSquaresArgs& args) {
  static_assert(optimizer_chunk % shared::squares_tile == 0);
  const uint64_t count = range_floats("sum of squares", args.gradients.bytes);
  for (uint64_t first = 0; first < count; first += optimizer_chunk) {
    const uint64_t floats = std::min(optimizer_chunk, count - first);
    const uint32_t first_partial = args.first_partial + squares_partials(first);
    const shared::SumOfSquaresConstants constants{static_cast<uint32_t>(floats / 4), first_partial};
    Launch launch;
    launch.pipeline = &commands.device().pipeline("optimizer/sum_of_squares");
    launch.name = "gradient norm, squares";
    launch.groups = {squares_partials(floats), 1, 1};
    launch.bindings = {
        {args.gradients.elements(first, floats), floats * 4},
        {args.partials, (uint64_t(first_partial) + squares_partials(floats)) * sizeof(shared::SquaresPartial)}};
    launch.push_constants = &constants;
    launch.push_constant_bytes = sizeof(constants);
    launch.after_previous = first == 0;  // chunks write different partials
    launch.cost = {static_cast<double>(floats) * 2, static_cast<double>(floats) * 4};
    commands.dispatch(launch);
  }
}

}  // namespace arah
