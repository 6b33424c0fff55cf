#include "kernels/tracing/several_starts.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/tracing.h"

namespace arah {

void record_bone_starts(Commands& commands, const BoneStartsArgs& args) {
  const uint32_t rows = args.rows.range.points;
  const shared::BoneStartConstants constants{rows, args.rank};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/bone_starts", rows_specialization(args.rows));
  launch.name = "starts from bones";
  launch.bindings = {args.posed, {args.frame, sizeof(FrameConstants)}, {args.segments, args.bones * 32ull}, args.starts};
  add_rows(launch, args.rows, args.frame);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * 60.0 * args.bones * (args.rank + 1), rows * 32.0};
  commands.dispatch(launch);
}

void record_keep_root(Commands& commands, const KeepRootArgs& args) {
  const uint32_t rows = args.rows.range.points;
  const shared::KeepRootConstants constants{rows, args.sdf.stride / 4, args.sdf.column / 4};
  std::vector<uint32_t> specialization = rows_specialization(args.rows);
  specialization.push_back(args.first ? 1u : 0u);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/keep_root", specialization);
  launch.name = "which root is kept";
  launch.bindings = {matrix_binding(args.sdf, rows), args.found, args.kept, args.kept_sdf};
  add_rows(launch, args.rows, args.kept);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * 1.0, rows * 56.0};
  commands.dispatch(launch);
}

}  // namespace arah
