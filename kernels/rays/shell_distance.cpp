#include "kernels/rays/shell_distance.h"

#include "kernels/linear/matrix.h"
#include "shaders/shared/rays.h"

namespace arah {

void record_shell_distance(Commands& commands, const ShellDistanceArgs& args) {
  const uint32_t nodes = node_count(args.grid), padded = padded_points(nodes);
  const shared::ShellDistanceConstants constants{args.grid, args.vertices};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("rays/shell_distance");
  launch.name = "shell grid distances";
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.nearest, uint64_t(nodes) * 4},
                     {args.positions, uint64_t(args.vertices) * 16},
                     {args.normals, uint64_t(args.vertices) * 16},
                     {args.distances, uint64_t(padded) * 4}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {nodes * 20.0, nodes * 40.0};
  commands.dispatch(launch);
}

}  // namespace arah
