#include "kernels/tracing/template_correspondence.h"

#include "shaders/shared/frame.h"

namespace arah {

void record_accept_starts(Commands& commands, const AcceptStartsArgs& args) {
  const uint64_t bytes = vec4_bytes(args.points);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/accept_starts");
  launch.name = "template correspondences";
  launch.groups = {padded_points(args.points) / point_padding, 1, 1};
  launch.bindings = {{args.targets, bytes}, {args.starts, bytes}, {args.canonical, bytes}};
  launch.cost = {0, 48.0 * args.points};
  commands.dispatch(launch);
}

void record_accept_traced(Commands& commands, const AcceptTracedArgs& args) {
  const uint64_t bytes = vec4_bytes(args.rays);
  const struct {
    uint32_t count;
    float tolerance;
  } constants{args.rays, args.tolerance};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/accept_traced");
  launch.name = "surface points of traced rays";
  launch.groups = {padded_points(args.rays) / point_padding, 1, 1};
  launch.bindings = {
      {args.trace, bytes}, {args.ends, bytes}, {args.canonical, bytes}, {args.depths, uint_bytes(args.rays)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {0, 52.0 * args.rays};
  commands.dispatch(launch);
}

void record_vertex_transforms(Commands& commands, const VertexTransformsArgs& args) {
  const uint32_t rows = args.rows.range.points;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/vertex_transforms", rows_specialization(args.rows));
  launch.name = "transforms of the nearest vertices";
  launch.bindings = {{args.frame, sizeof(FrameConstants)},
                     {args.nearest, args.rows.ids.empty() ? uint_bytes(rows) : 4},
                     args.target.joints,
                     args.target.weights,
                     {args.transforms, 3 * vec4_bytes(rows)}};
  add_rows(launch, args.rows, args.frame);
  launch.cost = {120.0 * rows, 52.0 * rows + table_bytes(20.0 * rows, double(args.target.joints.bytes + args.target.weights.bytes))};
  commands.dispatch(launch);
}

}  // namespace arah
