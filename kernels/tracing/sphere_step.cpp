#include "kernels/tracing/sphere_step.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/tracing.h"

namespace arah {
namespace {

void record(Commands& commands, const char* shader, const char* name, const Rows& rows, const SphereTracing& tracing,
            const Matrix& sdf, const shared::SphereConstants& constants) {
  std::vector<uint32_t> specialization = rows_specialization(rows);
  specialization.push_back(!tracing.kept.empty());
  specialization.push_back(!tracing.kept.empty() && tracing.from_shell);
  Launch launch;
  launch.pipeline = &commands.device().pipeline(shader, specialization);
  launch.name = name;
  launch.bindings = {
      {tracing.frame, sizeof(FrameConstants)},          tracing.rays, tracing.trace, tracing.posed, tracing.candidates,
      {tracing.active, uint_bytes(constants.row_limit)}, tracing.kept.empty() ? tracing.rays : tracing.kept};
  if (!sdf.empty()) launch.bindings.push_back(matrix_binding(sdf, constants.row_limit));
  add_rows(launch, rows, tracing.frame);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {constants.row_limit * 20.0, constants.row_limit * 92.0};
  commands.dispatch(launch);
}

}  // namespace

void record_sphere_start(Commands& commands, const Rows& rows, const SphereTracing& tracing) {
  record(commands, "tracing/sphere_start", "sphere tracing, start", rows, tracing, {}, {rows.range.points, 0, 0, 0, 0});
}

void record_sphere_step(Commands& commands, const SphereStepArgs& args) {
  check_channels("sphere tracing: sdf", args.sdf, 1);
  record(commands, "tracing/sphere_step", "sphere tracing, step", args.rows, args.tracing, args.sdf,
         {args.rows.range.points, args.sdf.stride / 4, args.sdf.column / 4, args.max_step, args.tolerance});
}

}  // namespace arah
