#include "kernels/skinning/inverse_blend.h"

#include "kernels/tracing/rows.h"

namespace arah {

void record_inverse_blend(Commands& commands, const InverseBlendArgs& args) {
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/inverse_blend");
  launch.name = "inverse of the blend";
  launch.groups = {padded_points(args.points) / point_padding, 1, 1};
  launch.bindings = {{args.targets, vec4_bytes(args.points)},
                     {args.transforms, 3 * vec4_bytes(args.points)},
                     {args.canonical, vec4_bytes(args.points)}};
  launch.push_constants = &args.points;
  launch.push_constant_bytes = sizeof(args.points);
  launch.cost = {args.points * 60.0, args.points * 16.0 * 5};
  commands.dispatch(launch);
}

}  // namespace arah
