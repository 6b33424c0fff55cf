#include "kernels/watch/scan.h"

#include <fmt/format.h>

#include <stdexcept>

namespace arah {

void record_watch(Commands& commands, const WatchArgs& args) {
  const bool texels = args.values.stride % 4 == 0 && args.values.column % 4 == 0;
  if (args.rows == 0 || args.channels < 1 || args.channels > (texels ? 4 : 1) || args.values.stride < args.channels || args.values.element != Element::float32 || !(args.limit > 0))
    throw std::invalid_argument(fmt::format("{}: {} rows of {} channels, stride {}, column {}, limit {}; expected at least 1 row of 1 to 4 floats at multiples of 4, or 1 anywhere, and a limit above 0",
                                            args.name, args.rows, args.channels, args.values.stride, args.values.column, args.limit));
  const shared::WatchConstants constants{args.rows, args.channels, args.values.stride, args.values.column, args.first_row, args.limit};
  const uint32_t padded = padded_points(args.rows);
  const bool masked = !args.points.empty(), indexed = !args.row_ids.empty();
  Launch launch;
  launch.pipeline = &commands.device().pipeline("watch/scan", {texels, masked, indexed});
  launch.name = std::string("watch, ") + args.name;
  launch.groups = {padded / point_padding, 1, 1};
  // What is not there is not read; the values stand in for it.
  const Binding values{args.values.slice, uint64_t(args.rows) * args.values.stride * 4};
  launch.bindings = {values, masked ? Binding{args.points, args.rows * 16ull} : values, indexed ? Binding{args.row_ids, args.rows * 4ull} : values, {args.record, sizeof(shared::WatchRecord)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.after_previous = args.after_previous;
  launch.cost = {args.rows * 4.0 * args.channels, args.rows * ((texels ? 16.0 : 4.0) + (masked ? 16.0 : 0.0))};
  commands.dispatch(launch);
}

}  // namespace arah
