#include "kernels/peak/arithmetic.h"

#include <fmt/format.h>

#include <stdexcept>

namespace arah {

void record_arithmetic_peak(Commands& commands, const ArithmeticPeakArgs& args) {
  if (args.rounds > ArithmeticPeakArgs::most_rounds)
    throw std::invalid_argument(fmt::format("arithmetic peak: {} rounds, at most {} are possible", args.rounds, ArithmeticPeakArgs::most_rounds));
  const struct {
    float factor, term;
    uint32_t rounds;
  } constants{args.factor, args.term, args.rounds};
  const double invocations = 64.0 * args.workgroups;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("peak/arithmetic");
  launch.name = "peak of arithmetic";
  launch.groups = {args.workgroups, 1, 1};
  launch.bindings = {{args.sums, 64ull * 4 * args.workgroups}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {2 * invocations * ArithmeticPeakArgs::chains * ArithmeticPeakArgs::links_a_round * args.rounds, 4 * invocations};
  commands.dispatch(launch);
}

}  // namespace arah
