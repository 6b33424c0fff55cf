#include "kernels/peak/bandwidth.h"

#include <fmt/format.h>

#include <stdexcept>

namespace arah {

void record_bandwidth_peak(Commands& commands, const BandwidthPeakArgs& args) {
  if (args.reads < 1 || args.reads > 64) throw std::invalid_argument(fmt::format("bandwidth peak: {} reads, expected 1 to 64", args.reads));
  const uint64_t bytes = 64ull * 32 * args.workgroups;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("peak/bandwidth", {args.reads});
  launch.name = "peak of bandwidth";
  launch.groups = {args.workgroups, 1, 1};
  launch.bindings = {{args.rows, bytes * args.reads}, {args.sums, bytes}};
  launch.cost = {8.0 * 64 * args.workgroups * args.reads, static_cast<double>(bytes) * (1 + args.reads)};
  commands.dispatch(launch);
}

}  // namespace arah
