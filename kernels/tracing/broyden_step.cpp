#include "kernels/tracing/broyden_step.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/tracing.h"

namespace arah {

void record_broyden_step(Commands& commands, const BroydenStepArgs& args) {
  const uint32_t rows = args.rows.range.points;
  const BroydenState& state = args.state;
  const bool joint = state.unknowns == Unknowns::point_and_depth;
  if (joint) check_channels("joint search: sdf", args.surface.sdf, 1);

  std::vector<uint32_t> specialization = rows_specialization(args.rows);
  specialization.push_back(static_cast<uint32_t>(state.unknowns));
  specialization.push_back(state.keeps_transforms);
  const shared::BroydenStepConstants constants{
      rows,           state.capacity,  args.surface.sdf.stride / 4, args.surface.sdf.column / 4, args.max_iterations,
      args.tolerance, args.divergence, args.denominator_offset};
  const Binding unused{args.posed};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/broyden_step", specialization);
  launch.name = joint ? "joint search, step" : "correspondence search, step";
  launch.bindings = {{args.frame, sizeof(FrameConstants)},
                     {args.posed, vec4_bytes(rows)},
                     state.keeps_transforms ? Binding{args.transforms, 3 * vec4_bytes(rows)} : unused,
                     joint ? unused : Binding{args.targets},
                     joint ? Binding{args.surface.rays} : unused,
                     joint ? matrix_binding(args.surface.sdf, rows) : unused,
                     {state.slice, BroydenState::bytes(state.capacity, state.unknowns, state.keeps_transforms)},
                     {args.active, uint_bytes(rows)}};
  add_rows(launch, args.rows, args.frame);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * (joint ? 200.0 : 120.0), rows * 16.0 * (joint ? 20 : 16)};
  commands.dispatch(launch);
}

}  // namespace arah
