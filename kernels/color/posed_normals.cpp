#include "kernels/color/posed_normals.h"

namespace arah {

void record_posed_normals(Commands& commands, const PosedNormalsArgs& a) {
  const uint64_t rows = padded_points(a.rows);
  const struct {
    uint32_t stride, column;
  } constants{a.gradients.stride / 4, a.gradients.column / 4};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("color/posed_normals", {a.unit_length, !a.transforms.empty()});
  launch.name = "posed normals";
  launch.groups = {static_cast<uint32_t>(rows / 64), 1, 1};
  launch.bindings = {{a.gradients.slice, rows * a.gradients.stride * 4}, a.transforms.empty() ? Binding{a.gradients.slice} : Binding{a.transforms, rows * 48}, {a.normals, rows * 16}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {24.0 * double(rows), 80.0 * double(rows)};
  commands.dispatch(launch);
}

}  // namespace arah
