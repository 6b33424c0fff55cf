#include "kernels/sampling/surface_samples.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/linear/matrix.h"
#include "shaders/shared/sampling.h"

namespace arah {

void record_surface_samples(Commands& commands, const SurfaceSamplesArgs& args) {
  if (args.around_surface % 2 == 0 ||
      args.around_surface + args.before_surface > args.slots || args.without_surface > args.slots)
    throw std::invalid_argument(
        fmt::format("surface samples: {} around (odd), {} before, {} without a surface do not fit {} slots",
                    args.around_surface, args.before_surface, args.without_surface, args.slots));
  const uint32_t rows = args.rays * args.slots, padded = padded_points(rows);
  const shared::SurfaceSamplesConstants constants{args.root_translation,    args.rays,           args.slots,
                                                  args.jitter.on ? 1u : 0u, args.jitter.seed,    args.jitter.step,
                                                  args.jitter.first_ray,    args.half_width,     args.around_surface,
                                                  args.before_surface,      args.without_surface};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("sampling/surface_samples");
  launch.name = "samples around the surface";
  launch.groups = {padded_points(args.rays) / point_padding, 1, 1};
  launch.bindings = {{args.ray_list, uint64_t(args.rays) * 32},
                     {args.surface_points, uint64_t(args.rays) * 16},
                     {args.surface_depths, uint64_t(args.rays) * 4},
                     {args.depths, uint64_t(padded) * 4},
                     {args.points, uint64_t(padded) * 16}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * 70.0, rows * 20.0};
  commands.dispatch(launch);
}

}  // namespace arah
