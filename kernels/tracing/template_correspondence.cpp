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
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/vertex_transforms");
  launch.name = "transforms of the nearest vertices";
  launch.groups = {padded_points(args.points) / point_padding, 1, 1};
  launch.bindings = {{args.frame, sizeof(FrameConstants)},
                     {args.nearest, uint_bytes(args.points)},
                     args.target.joints,
                     args.target.weights,
                     {args.transforms, 3 * vec4_bytes(args.points)}};
  launch.cost = {120.0 * args.points, 270.0 * args.points};
  commands.dispatch(launch);
}

}  // namespace arah
