#include "kernels/sampling/least_distance.h"

#include "shaders/shared/sampling.h"

namespace arah {

void record_least_distance(Commands& commands, const LeastDistanceArgs& args) {
  const shared::LeastDistanceConstants constants{args.rays, args.samples, args.sdf.stride / 4, args.sdf.column / 4};
  const uint64_t rows = uint64_t(args.rays) * args.samples;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("sampling/least_distance");
  launch.name = "least distances of rays";
  launch.groups = {padded_points(args.rays) / point_padding, 1, 1};
  launch.bindings = {{args.sdf.slice, rows * args.sdf.stride * 4}, {args.points, rows * 16}, {args.least, uint64_t(padded_points(args.rays)) * 16}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {static_cast<double>(rows) * 4, static_cast<double>(rows) * 32};
  commands.dispatch(launch);
}

}  // namespace arah
