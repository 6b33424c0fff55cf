#include "kernels/reduction/sum.h"

#include "shaders/shared/reduction.h"

namespace arah {

void record_sum(Commands& commands, const SumArgs& args) {
  const shared::SumConstants constants{args.rows, args.columns, args.sum_index};
  const uint64_t numbers = uint64_t(args.rows) * args.columns;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("reduction/sum");
  launch.name = args.name;
  launch.groups = {args.columns, 1, 1};
  launch.bindings = {{args.partials, numbers * 4}, {args.sums, (uint64_t(args.sum_index) + args.columns) * 4}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {static_cast<double>(numbers), static_cast<double>(numbers) * 4};
  commands.dispatch(launch);
}

}  // namespace arah
