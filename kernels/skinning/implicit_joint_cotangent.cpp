#include "kernels/skinning/implicit_joint_cotangent.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/ray.h"

namespace arah {

void record_implicit_joint_cotangent(Commands& commands, const ImplicitJointCotangentArgs& args) {
  check_channels("the sdf's gradient", args.sdf_gradients, 3);
  check_channels("the sdf's cotangent", args.sdf_cotangents, 4);
  const shared::ImplicitJointConstants constants{args.rays, args.sdf_gradients.stride / 4, args.sdf_gradients.column / 4,
                                                 args.sdf_cotangents.stride / 4, args.sdf_cotangents.column / 4};
  const bool listed = !args.of_row.empty();
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/implicit_joint_cotangent", {listed ? 0u : 1u});
  launch.name = "implicit joint cotangent";
  launch.groups = {padded_points(args.rays) / point_padding, 1, 1};
  launch.bindings = {{args.jacobians, 3 * vec4_bytes(args.rays)},
                     matrix_binding(args.sdf_gradients, args.rays),
                     {args.ray_list, uint64_t(listed ? args.listed : args.rays) * sizeof(Ray)},
                     {args.upstream, vec4_bytes(args.rays)},
                     {args.canonical, vec4_bytes(args.rays)},
                     {args.cotangents, vec4_bytes(args.rays)},
                     matrix_binding(args.sdf_cotangents, args.rays),
                     {args.counts, sizeof(shared::ImplicitCounts)},
                     {args.frame, sizeof(FrameConstants)},
                     // What is not used needs a buffer all the same.
                     listed ? Binding(args.of_row, uint_bytes(args.rays)) : Binding(args.counts, sizeof(shared::ImplicitCounts))};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {args.rays * 200.0, args.rays * 16.0 * 10};
  commands.dispatch(launch);
}

}  // namespace arah
