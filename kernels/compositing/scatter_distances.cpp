#include "kernels/compositing/scatter_distances.h"

namespace arah {

void record_scatter_distances(Commands& commands, const ScatterDistancesArgs& args) {
  const uint64_t padded = padded_points(args.count);
  const struct {
    uint32_t count, sdf_stride, sdf_column;
  } constants{args.count, args.sdf.stride / 4, args.sdf.column / 4};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("compositing/scatter_distances");
  launch.name = "distances to their samples";
  launch.groups = {static_cast<uint32_t>(padded / point_padding), 1, 1};
  launch.bindings = {{args.samples, padded * 4}, {args.sdf.slice, padded * args.sdf.stride * 4}, args.distances};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {0, 36.0 * args.count};
  commands.dispatch(launch);
}

}  // namespace arah
