#include "kernels/tracing/damped_newton.h"

namespace arah {

void record_mark_unsolved(Commands& commands, const MarkUnsolvedArgs& args) {
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/mark_unsolved");
  launch.name = "points without a root";
  launch.groups = {padded_points(args.points) / point_padding, 1, 1};
  launch.bindings = {{args.targets, vec4_bytes(args.points)}, {args.canonical, vec4_bytes(args.points)}, {args.flags, uint_bytes(args.points)}};
  launch.cost = {0, args.points * 36.0};
  commands.dispatch(launch);
}

void record_damped_newton_start(Commands& commands, const DampedNewtonArgs& args) {
  const uint32_t rows = args.rows.range.points;
  const shared::DampedNewtonConstants constants{rows, args.tolerance};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/damped_newton_start", rows_specialization(args.rows));
  launch.name = "damped Newton, start";
  launch.bindings = {args.starts, args.canonical, {args.state, padded_points(rows) * damped_newton_state_bytes}, {args.trials, vec4_bytes(rows)}};
  add_rows(launch, args.rows, args.starts);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {0, rows * 140.0};
  commands.dispatch(launch);
}

void record_damped_newton(Commands& commands, const DampedNewtonArgs& args) {
  const uint32_t rows = args.rows.range.points;
  const shared::DampedNewtonConstants constants{rows, args.tolerance};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/damped_newton", rows_specialization(args.rows));
  launch.name = "damped Newton";
  launch.bindings = {{args.posed, vec4_bytes(rows)},
                     {args.jacobians, 3 * vec4_bytes(rows)},
                     args.targets,
                     {args.state, padded_points(rows) * damped_newton_state_bytes},
                     {args.trials, vec4_bytes(rows)},
                     args.canonical,
                     {args.counts, sizeof(DampedNewtonCounts)}};
  add_rows(launch, args.rows, args.targets);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * 120.0, rows * 280.0};
  commands.dispatch(launch);
}

}  // namespace arah
