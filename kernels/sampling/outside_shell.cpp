#include "kernels/sampling/outside_shell.h"

#include "kernels/linear/matrix.h"
#include "shaders/shared/sampling.h"

namespace arah {

void record_outside_shell(Commands& commands, const OutsideShellArgs& args) {
  const shared::OutsideShellConstants constants{args.grid, args.outer, args.rows};
  const uint64_t bytes = uint64_t(padded_points(args.rows)) * 16;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("sampling/outside_shell");
  launch.name = "samples outside the shell";
  launch.groups = {padded_points(args.rows) / point_padding, 1, 1};
  launch.bindings = {{args.points, bytes}, {args.distances, node_count(args.grid) * 4ull}, {args.points, bytes}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {args.rows * 30.0, args.rows * 32.0 + table_bytes(args.rows * 32.0, node_count(args.grid) * 4.0)};
  commands.dispatch(launch);
}

}  // namespace arah
