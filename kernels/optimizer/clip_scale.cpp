#include "kernels/optimizer/clip_scale.h"

namespace arah {

void record_clip_scale(Commands& commands, const ClipScaleArgs& args) {
  const shared::ClipScaleConstants constants{args.partials_count, args.norm_index, args.max_norm};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("optimizer/clip_scale");
  launch.name = "gradient norm, clipping factor";
  launch.bindings = {{args.partials, uint64_t(args.partials_count) * sizeof(shared::SquaresPartial)},
                     {args.norms, (uint64_t(args.norm_index) + 1) * sizeof(shared::GradientNorm)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {static_cast<double>(args.partials_count), args.partials_count * 8.0};
  commands.dispatch(launch);
}

}  // namespace arah
