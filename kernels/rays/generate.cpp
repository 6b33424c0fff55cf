#include "kernels/rays/generate.h"

#include <algorithm>
#include <stdexcept>

#include "kernels/linear/matrix.h"
#include "shaders/shared/rays.h"

namespace arah {

void record_generate_rays(Commands& commands, const GenerateRaysArgs& args) {
  const bool listed = !args.pixels.empty();
  if (!listed && args.rectangle.width == 0) throw std::invalid_argument("rays of a rectangle without width");
  shared::GenerateConstants constants;
  for (size_t row = 0; row < 3; ++row)
    std::copy_n(args.camera.rotation.begin() + 3 * row, 3, constants.rotation_rows[row].begin());
  constants.origin = args.camera.origin;
  constants.fx = args.camera.fx;
  constants.fy = args.camera.fy;
  constants.cx = args.camera.cx;
  constants.cy = args.camera.cy;
  constants.box_minimum = args.box.minimum;
  constants.box_maximum = args.box.maximum;
  constants.corner = {args.rectangle.left, args.rectangle.top};
  constants.width = args.rectangle.width;
  constants.count = args.count;

  const uint32_t padded = padded_points(args.count);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("rays/generate", {listed ? 1u : 0u});
  launch.name = "rays of pixels";
  launch.groups = {padded / point_padding, 1, 1};
  // A rectangle reads no list, but every binding needs a buffer.
  launch.bindings = {{listed ? args.pixels : args.rays, uint64_t(args.count) * 4}, {args.rays, uint64_t(padded) * 32}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {args.count * 60.0, args.count * 36.0};
  commands.dispatch(launch);
}

}  // namespace arah
