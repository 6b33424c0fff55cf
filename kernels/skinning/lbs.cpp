#include "kernels/skinning/lbs.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/skinning.h"

namespace arah {

void record_lbs(Commands& commands, const LbsArgs& args) {
  const JointTree& tree = *args.tree;
  const uint32_t rows = args.rows.range.points, joints = tree.joints();
  const bool transforms = !args.transforms.empty(), weights = !args.weights.empty();
  check_channels("skinning: logits", args.logits, tree.logits());
  if (weights) check_channels("skinning: weights", args.weights, joints);

  std::vector<uint32_t> specialization = tree.specialization();
  for (const uint32_t constant : rows_specialization(args.rows)) specialization.push_back(constant);
  specialization.push_back(transforms);
  specialization.push_back(weights);
  const shared::LbsConstants constants{rows, args.logits.stride / 4, args.logits.column / 4, args.weights.stride / 8,
                                       args.weights.column / 8};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/lbs", specialization);
  launch.name = "linear blend skinning";
  launch.bindings = {matrix_binding(args.logits, rows),
                     {args.frame, sizeof(FrameConstants)},
                     args.canonical,
                     {args.posed, vec4_bytes(rows)},
                     transforms ? Binding{args.transforms, 3 * vec4_bytes(rows)} : Binding{args.posed},
                     weights ? matrix_binding(args.weights, rows) : Binding{args.posed}};
  add_rows(launch, args.rows, args.frame);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * (joints * 60.0 + 18), rows * 4.0 * (tree.logits() + 8 + 12 * transforms + joints * weights)};
  commands.dispatch(launch);
}

}  // namespace arah
