#include "kernels/skinning/jacobian.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/skinning.h"

namespace arah {

void record_jacobian(Commands& commands, const JacobianArgs& args) {
  const uint32_t rows = args.range.points;
  shared::JacobianConstants constants{};
  for (size_t i = 0; i < 3; ++i) {
    check_channels("skinning Jacobian: gradient", args.gradients[i], 3);
    constants.stride[i] = args.gradients[i].stride / 4;
    constants.column[i] = args.gradients[i].column / 4;
  }
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/jacobian");
  launch.name = "skinning Jacobian";
  set_range(launch, args.range);
  launch.bindings = {{args.frame, sizeof(FrameConstants)},    {args.transforms, 3 * vec4_bytes(rows)},
                     matrix_binding(args.gradients[0], rows), matrix_binding(args.gradients[1], rows),
                     matrix_binding(args.gradients[2], rows), {args.jacobians, 3 * vec4_bytes(rows)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * 18.0, rows * 4.0 * 33};
  commands.dispatch(launch);
}

}  // namespace arah
