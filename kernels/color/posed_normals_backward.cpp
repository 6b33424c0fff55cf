#include "kernels/color/posed_normals_backward.h"

#include "kernels/tracing/rows.h"

namespace arah {

void record_posed_normals_backward(Commands& commands, const PosedNormalsBackwardArgs& args) {
  check_channels("posed normals backward: gradients", args.d_gradients, channel_padding);
  const struct {
    uint32_t stride, column;
  } constants{args.d_gradients.stride / channel_padding, args.d_gradients.column / channel_padding};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("color/posed_normals_backward", {!args.transforms.empty()});
  launch.name = "posed normals backward";
  launch.groups = {padded_points(args.rows) / point_padding, 1, 1};
  launch.bindings = {{args.d_normals, vec4_bytes(args.rows)},
                     args.transforms.empty() ? Binding{args.d_normals} : Binding{args.transforms, 3 * vec4_bytes(args.rows)},
                     matrix_binding(args.d_gradients, args.rows)};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {18.0 * args.rows, 96.0 * args.rows};
  commands.dispatch(launch);
}

}  // namespace arah
