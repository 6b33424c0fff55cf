#include "kernels/compositing/forward.h"

#include "kernels/compositing/sample_constants.h"

namespace arah {

void record_composite_forward(Commands& commands, const CompositeForwardArgs& args) {
  const CompositeSamples& s = args.samples;
  const shared::CompositeConstants constants = composite_constants(s, args.last_delta, args.least_weight);
  const uint64_t rows = uint64_t(s.rays) * s.samples, padded_rays = padded_points(s.rays);
  const bool differences = args.delta_mode == DeltaMode::differences, selects = !args.flags.empty();
  const uint32_t shading = selects             ? shared::SHADING_SELECTS
                           : s.slots.empty() ? shared::SHADING_BY_ROW
                           : s.groups        ? shared::SHADING_BY_GROUP
                                             : shared::SHADING_BY_SLOT;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("compositing/forward", {differences ? 1u : 0u, shading, static_cast<uint32_t>(s.density)});
  launch.name = selects ? "compositing weights" : "compositing forward";
  launch.groups = {padded_points(s.rays) / point_padding, 1, 1};
  launch.bindings = {{s.sdf.slice, rows * s.sdf.stride * 4},
                     selects ? Binding{s.sdf.slice} : Binding{s.rgb.slice, rgb_bytes(s)},
                     {s.points, rows * 16},
                     {args.depths, rows * 4},
                     {s.deltas, rows * 4},
                     {s.parameters, (uint64_t(s.scale_index) + 1) * 4},
                     {args.colors, padded_rays * 16},
                     {args.ray_depths, padded_rays * 4},
                     {args.weights, rows * 4},
                     {args.transmittances, rows * 4},
                     s.slots.empty() ? Binding{args.weights} : Binding{s.slots, rows * 4},
                     selects ? Binding{args.flags, rows * 4} : Binding{args.weights}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {static_cast<double>(rows) * 60, static_cast<double>(rows) * (differences ? 48 : 36)};
  commands.dispatch(launch);
}

}  // namespace arah
