#include "kernels/skinning/weights_loss.h"

#include "kernels/reduction/sum.h"
#include "shaders/shared/skinning.h"

namespace arah {

void record_weights_loss(Commands& commands, const WeightsLossArgs& args) {
  const JointTree& tree = *args.tree;
  const uint32_t points = args.points, groups = padded_points(points) / point_padding;
  check_channels("skinning loss: logits", args.logits, tree.logits());
  check_channels("skinning loss: d_logits", args.d_logits, tree.logits());
  if (points == 0) return;

  const shared::WeightsLossConstants constants{points,
                                               args.logits.stride / 4,
                                               args.logits.column / 4,
                                               args.d_logits.stride / 8,
                                               args.d_logits.column / 8,
                                               args.weight / static_cast<float>(points)};
  std::vector<uint32_t> specialization = tree.specialization();
  specialization.push_back(args.measure == WeightsMeasure::cross_entropy);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/weights_loss", specialization);
  launch.name = "skinning loss";
  launch.groups = {groups, 1, 1};
  launch.bindings = {matrix_binding(args.logits, points),
                     {args.target_joints, uint_bytes(points)},
                     {args.target_weights, vec4_bytes(points)},
                     matrix_binding(args.d_logits, points),
                     {args.scratch, partial_bytes(points)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {points * tree.joints() * 80.0, points * 4.0 * (2.0 * tree.logits() + 5)};
  commands.dispatch(launch);

  record_sum(commands, {"skinning loss, sum", groups, 1, args.scratch, args.losses, args.slot});
}

}  // namespace arah
