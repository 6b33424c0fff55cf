#include "kernels/tracing/broyden_start.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/tracing.h"

namespace arah {

void record_broyden_start(Commands& commands, const BroydenStartArgs& args) {
  const uint32_t rows = args.rows.range.points;
  const BroydenState& state = args.state;
  const bool joint = state.unknowns == Unknowns::point_and_depth;
  if (joint) {
    check_channels("joint search: sdf", args.surface.sdf, 1);
    check_channels("joint search: sdf gradient", args.sdf_gradients, 3);
  }
  if (!args.rows.ids.empty()) commands.fill(state.status(), 0);

  std::vector<uint32_t> specialization = rows_specialization(args.rows);
  specialization.push_back(static_cast<uint32_t>(state.unknowns));
  specialization.push_back(state.keeps_transforms);
  const shared::BroydenStartConstants constants{rows,
                                                state.capacity,
                                                args.surface.sdf.stride / 4,
                                                args.surface.sdf.column / 4,
                                                args.sdf_gradients.stride / 4,
                                                args.sdf_gradients.column / 4,
                                                args.max_iterations,
                                                args.start_tolerance};
  const Binding unused{args.starts};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/broyden_start", specialization);
  launch.name = joint ? "joint search, start" : "correspondence search, start";
  launch.bindings = {{args.frame, sizeof(FrameConstants)},
                     args.starts,
                     {args.posed, vec4_bytes(rows)},
                     {args.transforms, 3 * vec4_bytes(rows)},
                     joint ? unused : Binding{args.targets},
                     joint ? Binding{args.surface.rays} : unused,
                     joint ? Binding{args.depths} : unused,
                     joint ? matrix_binding(args.surface.sdf, rows) : unused,
                     joint ? matrix_binding(args.sdf_gradients, rows) : unused,
                     joint ? Binding{args.jacobians, 3 * vec4_bytes(rows)} : unused,
                     {state.slice, BroydenState::bytes(state.capacity, state.unknowns, state.keeps_transforms)},
                     {args.active, uint_bytes(rows)}};
  add_rows(launch, args.rows, args.frame);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * (joint ? 300.0 : 80.0), rows * 16.0 * (joint ? 22 : 15)};
  commands.dispatch(launch);
}

}  // namespace arah
