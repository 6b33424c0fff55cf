#include "kernels/tracing/interpolate_distances.h"

#include "shaders/shared/tracing.h"

namespace arah {

void record_interpolate_distances(Commands& commands, const InterpolateDistancesArgs& args) {
  const shared::InterpolateDistancesConstants constants{args.nodes.grid, args.rows};
  const uint64_t bytes = uint64_t(padded_points(args.rows)) * 16;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/interpolate_distances");
  launch.name = "distances from a grid";
  launch.groups = {padded_points(args.rows) / point_padding, 1, 1};
  launch.bindings = {{args.points, bytes}, {args.nodes.distances, node_count(args.nodes.grid) * 4ull}, {args.interpolated, bytes}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {args.rows * 30.0, args.rows * (32.0 + 8 * 16)};
  commands.dispatch(launch);
}

}  // namespace arah
