#include "kernels/tracing/broyden_finish.h"

namespace arah {

void record_broyden_finish(Commands& commands, const BroydenFinishArgs& args) {
  const BroydenState& state = args.state;
  const bool joint = state.unknowns == Unknowns::point_and_depth;
  const shared::BroydenFinishConstants constants{args.points, state.capacity};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/broyden_finish", {static_cast<uint32_t>(state.unknowns), 0, !args.interpolated.empty()});
  launch.name = joint ? "joint search, results" : "correspondence search, results";
  launch.groups = {padded_points(args.points) / point_padding, 1, 1};
  launch.bindings = {{state.slice, BroydenState::bytes(state.capacity, state.unknowns, false)},
                     joint ? Binding{args.rays, args.points * 32ull} : Binding{state.slice},
                     {args.canonical, vec4_bytes(args.points)},
                     joint ? Binding{args.depth, uint_bytes(args.points)} : Binding{args.canonical},
                     {args.counts, sizeof(shared::SearchCounts)},
                     args.interpolated.empty() ? Binding{state.slice} : Binding{args.interpolated, vec4_bytes(args.points)},
                     joint ? Binding{state.slice} : Binding{args.targets, args.points * 16ull}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {0, args.points * 16.0 * 3};
  commands.dispatch(launch);
}

}  // namespace arah
