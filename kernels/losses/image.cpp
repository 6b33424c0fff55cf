#include "kernels/losses/image.h"

#include "kernels/reduction/sum.h"
#include "shaders/shared/losses.h"

namespace arah {

void record_image_loss(Commands& commands, const ImageLossArgs& args) {
  const shared::ImageLossConstants constants{args.rays, 1 / args.normaliser, args.color_weight, args.alpha_weight};
  const uint32_t padded = padded_points(args.rays);
  Launch launch;
  const bool weighted = !args.weights.empty();
  launch.pipeline = &commands.device().pipeline("losses/image", {weighted ? 1u : 0u});
  launch.name = "colour and mask losses";
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.colors, uint64_t(args.rays) * 16},
                     {args.targets, uint64_t(args.rays) * 16},
                     {args.d_colors, uint64_t(padded) * 16},
                     {args.partials, partial_bytes(args.rays, 2)},
                     // What is not used needs a buffer all the same.
                     weighted ? Binding(args.weights, uint64_t(args.rays) * 4) : Binding(args.targets)};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {args.rays * 60.0, args.rays * 48.0};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = "sums of colour and mask losses";
  sum.rows = padded / point_padding;
  sum.columns = 2;
  sum.partials = args.partials;
  sum.sums = args.losses;
  sum.sum_index = args.slot;
  record_sum(commands, sum);
}

}  // namespace arah
