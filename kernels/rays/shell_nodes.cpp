#include "kernels/rays/shell_nodes.h"

#include <limits>
#include <stdexcept>
#include <string>

#include "kernels/linear/matrix.h"

namespace arah {

uint32_t node_count(const ShellGrid& grid) {
  uint64_t count = 1;
  for (size_t axis = 0; axis < 3; ++axis) {
    if (grid.nodes[axis] < 2)
      throw std::invalid_argument(std::string("a shell grid has ") + std::to_string(grid.nodes[axis]) +
                                  " nodes along " + "xyz"[axis] + ", it needs at least 2");
    count *= grid.nodes[axis];
    if (count > std::numeric_limits<int32_t>::max())
      throw std::invalid_argument("a shell grid of more than 2^31 - 1 nodes");
  }
  return static_cast<uint32_t>(count);
}

void record_shell_nodes(Commands& commands, const ShellNodesArgs& args) {
  const uint32_t padded = padded_points(node_count(args.grid));
  Launch launch;
  launch.pipeline = &commands.device().pipeline("rays/shell_nodes");
  launch.name = "shell grid nodes";
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.points, uint64_t(padded) * 16}};
  launch.push_constants = &args.grid;
  launch.push_constant_bytes = sizeof(args.grid);
  launch.cost = {padded * 6.0, padded * 16.0};
  commands.dispatch(launch);
}

}  // namespace arah
