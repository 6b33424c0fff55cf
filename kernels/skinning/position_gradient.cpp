#include "kernels/skinning/position_gradient.h"

#include "shaders/shared/frame.h"

namespace arah {

void record_position_gradient(Commands& commands, const PositionGradientArgs& a) {
  const uint64_t rows = padded_points(a.points);
  const struct {
    uint32_t stride, column;
  } constants{a.through_sdf.stride / 4, a.through_sdf.column / 4};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/position_gradient");
  launch.name = "gradient at the canonical points";
  launch.groups = {static_cast<uint32_t>(rows / 64), 1, 1};
  launch.bindings = {{a.through_sdf.slice, rows * a.through_sdf.stride * 4}, {a.direct, rows * 16}, {a.frame, sizeof(FrameConstants)}, {a.upstream, rows * 16}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {6.0 * double(rows), 48.0 * double(rows)};
  commands.dispatch(launch);
}

}  // namespace arah
