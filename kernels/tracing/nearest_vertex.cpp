#include "kernels/tracing/nearest_vertex.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/tracing.h"

namespace arah {

void record_nearest_vertex(Commands& commands, const NearestVertexArgs& args) {
  const uint32_t rows = args.rows.range.points;
  const VertexGrid& grid = args.target.grid;
  const uint64_t cells = uint64_t(grid.cells[0]) * grid.cells[1] * grid.cells[2];
  const shared::NearestVertexConstants constants{rows, grid.origin, grid.cell_size, grid.cells};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/nearest_vertex", rows_specialization(args.rows));
  launch.name = "nearest vertex";
  launch.bindings = {args.posed,
                     {args.frame, sizeof(FrameConstants)},
                     {args.target.cell_start, (cells + 1) * 4},
                     {args.target.cell_seed, cells * 4},
                     args.target.vertices,
                     args.target.joints,
                     args.target.weights,
                     args.canonical,
                     args.nearest};
  add_rows(launch, args.rows, args.frame);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  // Some three occupied cells of a handful of vertices each; the blend of four transforms dominates the arithmetic.
  const double table = double(args.target.vertices.bytes + args.target.joints.bytes + args.target.weights.bytes) + 8.0 * double(cells);
  launch.cost = {rows * 300.0, rows * 40.0 + table_bytes(rows * 16.0 * 30, table)};
  commands.dispatch(launch);
}

}  // namespace arah
