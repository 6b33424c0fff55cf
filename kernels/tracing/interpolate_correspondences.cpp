#include "kernels/tracing/interpolate_correspondences.h"

#include "kernels/rays/shell_bins.h"
#include "shaders/shared/tracing.h"

namespace arah {

void record_interpolate_correspondences(Commands& commands, const InterpolateCorrespondencesArgs& args) {
  const shared::ShellGrid& grid = args.nodes.grid;
  const shared::InterpolateConstants constants{args.points, grid.origin, grid.cell, grid.nodes, args.nodes.longest};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/interpolate_correspondences");
  launch.name = "correspondences from a grid";
  launch.groups = {padded_points(args.points) / point_padding, 1, 1};
  launch.bindings = {{args.targets, args.points * 16ull},
                     {args.nodes.slots, node_count(grid) * 4ull},
                     {args.nodes.canonical, 16},
                     {args.interpolated, vec4_bytes(args.points)},
                     {args.flags, uint_bytes(args.points)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  // eight nodes a point: the slot and the root of each
  launch.cost = {args.points * 160.0, args.points * 36.0 + table_bytes(args.points * 8 * 20.0, node_count(grid) * 4.0 + double(args.nodes.canonical.bytes))};
  commands.dispatch(launch);
}

}  // namespace arah
