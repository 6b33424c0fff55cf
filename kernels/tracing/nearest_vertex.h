// The nearest posed template vertex and the approximate backward skinning through it (ARAH.md section 4).
#pragma once

#include "kernels/tracing/rows.h"
#include "kernels/tracing/vertex_grid.h"

namespace arah {

// A posed template on the device.
struct PosedVertices {
  VertexGrid grid;         // origin, cell_size and cells are read; its arrays need not be kept on the host
  BufferSlice vertices;    // grid.vertices
  BufferSlice cell_start;  // grid.cell_start
  BufferSlice cell_seed;   // grid.cell_seed
  BufferSlice joints;      // uint32 by vertex: its four joints of 8 bits, the first in the lowest bits
  BufferSlice weights;     // vec4 by vertex: their weights, with a sum of nearly 1
};

// The vertex nearest to each row's point, exactly (float32 distances; of equally near ones the lowest index; index 0
// for a point that is not finite), and x = T⁻¹ q with its four influences.
struct NearestVertexArgs {
  Rows rows;
  BufferSlice frame;  // FrameConstants of the pose that the vertices are in
  BufferSlice posed;  // vec4 by point: q, posed space, metres
  PosedVertices target;
  BufferSlice canonical;  // out, vec4 by point: x, metres; w = distance to the vertex, metres
  BufferSlice nearest;    // out, uint32 by point: the vertex
};
void record_nearest_vertex(Commands& commands, const NearestVertexArgs& args);

}  // namespace arah
