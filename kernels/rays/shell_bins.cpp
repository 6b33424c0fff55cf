#include "kernels/rays/shell_bins.h"

#include <limits>
#include <stdexcept>
#include <string>

#include "kernels/linear/matrix.h"
#include "shaders/shared/rays.h"

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

void record_shell_bins(Commands& commands, const ShellBinsArgs& args) {
  const uint32_t padded = padded_points(args.count);
  const shared::ShellBinsConstants constants{args.grid, args.root_translation, args.outer, args.inner, args.count};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("rays/shell_bins");
  launch.name = "shell bins of rays";
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.rays, uint64_t(args.count) * 32},
                     {args.distances, uint64_t(padded_points(node_count(args.grid))) * 4},
                     {args.kept, uint64_t(padded) * 8},
                     {args.kept_counts, uint64_t(padded) * 4}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  // 64 bins a ray, between eight nodes each
  launch.cost = {args.count * 64 * 60.0, args.count * 44.0 + table_bytes(args.count * 64 * 32.0, node_count(args.grid) * 4.0)};
  commands.dispatch(launch);
}

}  // namespace arah
