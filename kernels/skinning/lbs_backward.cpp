#include "kernels/skinning/lbs_backward.h"

#include <fmt/format.h>

#include <stdexcept>

#include "shaders/shared/frame.h"
#include "shaders/shared/skinning.h"

namespace arah {

void record_lbs_backward(Commands& commands, const LbsBackwardArgs& args) {
  const JointTree& tree = *args.tree;
  const uint32_t rows = args.rows.range.points, joints = tree.joints();
  const bool reads = args.component == 3, direct = !args.d_canonical.empty();
  if (args.component > 3)
    throw std::invalid_argument(fmt::format("skinning backward: component {}, expected 0 to 3", args.component));
  check_channels("skinning backward: logits", args.logits, tree.logits());
  check_channels("skinning backward: d_logits", args.d_logits, tree.logits());

  std::vector<uint32_t> specialization = tree.specialization();
  for (const uint32_t constant : rows_specialization(args.rows)) specialization.push_back(constant);
  specialization.push_back(args.component);
  specialization.push_back(direct);
  const shared::LbsBackwardConstants constants{rows, args.logits.stride / 4, args.logits.column / 4,
                                               args.d_logits.stride / 8, args.d_logits.column / 8};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/lbs_backward", specialization);
  launch.name = "linear blend skinning backward";
  launch.bindings = {matrix_binding(args.logits, rows),
                     {args.frame, sizeof(FrameConstants)},
                     args.canonical,
                     reads ? Binding{args.cotangents, vec4_bytes(rows)} : Binding{args.canonical},
                     matrix_binding(args.d_logits, rows),
                     direct ? Binding{args.d_canonical, vec4_bytes(rows)} : Binding{args.d_logits.slice}};
  add_rows(launch, args.rows, args.frame);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * joints * 80.0, rows * 4.0 * (2.0 * tree.logits() + 4 + 4 * reads + 4 * direct)};
  commands.dispatch(launch);
}

}  // namespace arah
