#include "kernels/skinning/implicit_cotangent.h"

namespace arah {

void record_implicit_cotangent(Commands& commands, const ImplicitCotangentArgs& args) {
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/implicit_cotangent");
  launch.name = "implicit cotangent";
  launch.groups = {padded_points(args.points) / point_padding, 1, 1};
  launch.bindings = {{args.jacobians, 3 * vec4_bytes(args.points)},
                     {args.upstream, vec4_bytes(args.points)},
                     {args.canonical, vec4_bytes(args.points)},
                     {args.cotangents, vec4_bytes(args.points)},
                     {args.counts, sizeof(shared::ImplicitCounts)}};
  launch.push_constants = &args.points;
  launch.push_constant_bytes = sizeof(args.points);
  launch.cost = {args.points * 60.0, args.points * 16.0 * 6};
  commands.dispatch(launch);
}

}  // namespace arah
