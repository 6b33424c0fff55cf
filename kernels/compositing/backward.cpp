#include "kernels/compositing/backward.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/compositing/sample_constants.h"
#include "kernels/reduction/sum.h"

namespace arah {

void record_composite_backward(Commands& commands, const CompositeBackwardArgs& args) {
  const CompositeSamples& s = args.samples;
  for (const uint32_t number : {args.d_sdf.stride, args.d_sdf.column, args.d_sdf_columns, args.d_rgb.stride,
                                args.d_rgb.column, args.d_rgb_columns})
    if (number % 4)
      throw std::invalid_argument(
          fmt::format("compositing backward: a gradient's stride, column or width is {}, "
                      "multiples of 4 expected",
                      number));
  const bool by_slot = !s.slots.empty();
  const uint32_t padded = padded_points(by_slot ? s.slot_count : s.rays * s.samples);
  const uint64_t rows = uint64_t(s.rays) * s.samples;
  const shared::CompositeBackwardConstants constants{composite_constants(s, 0), args.d_sdf.stride, args.d_sdf.column,
                                                     args.d_rgb.stride,         args.d_rgb.column, padded};
  Launch launch;
  launch.pipeline =
      &commands.device().pipeline("compositing/backward", {args.d_sdf_columns / 4, args.d_rgb_columns / 4, by_slot ? shared::SHADING_BY_SLOT : shared::SHADING_BY_ROW, static_cast<uint32_t>(s.density)});
  launch.name = "compositing backward";
  launch.groups = {padded_points(s.rays) / point_padding, 1, 1};
  launch.bindings = {{s.sdf.slice, rows * s.sdf.stride * 4},
                     {s.rgb.slice, rgb_bytes(s)},
                     {s.points, rows * 16},
                     {s.deltas, rows * 4},
                     {s.parameters, (uint64_t(s.scale_index) + 1) * 4},
                     {args.transmittances, rows * 4},
                     {args.colors, uint64_t(s.rays) * 16},
                     {args.d_colors, uint64_t(s.rays) * 16},
                     {args.d_sdf.slice, uint64_t(padded) * args.d_sdf.stride * 4},
                     {args.d_rgb.slice, uint64_t(padded) * args.d_rgb.stride * 4},
                     {args.partials, partial_bytes(s.rays)},
                     by_slot ? Binding{s.slots, rows * 4} : Binding{s.deltas}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {static_cast<double>(rows) * 80,
                 static_cast<double>(rows) * (32.0 + 4.0 * (args.d_sdf_columns + args.d_rgb_columns))};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = "gradient of the density scale";
  sum.rows = padded_points(s.rays) / point_padding;
  sum.partials = args.partials;
  sum.sums = args.gradients;
  sum.sum_index = s.scale_index;
  record_sum(commands, sum);
}

}  // namespace arah
