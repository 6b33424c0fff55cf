// Marching cubes over any set of cubes: the triangles of a zero set between their nodes (reference::marching_cubes).
// Two calls with a look at the totals between, so that the mesh gets exactly the room that it needs.
#pragma once

#include "kernels/vulkan/commands.h"
#include "shaders/shared/meshing.h"

namespace arah {

using shared::MeshCount;

inline constexpr uint32_t marching_most_cells = 4u << 20;  // their corners in one binding of 128 MiB, which every device takes
inline constexpr uint32_t no_cell = ~0u;
constexpr uint32_t marching_blocks(uint32_t cells) { return (cells + 2047) / 2048; }

// The bytes that the kernels read: the 256 cases of cube_cases.h.
std::vector<uint32_t> marching_case_words();

struct MarchingCells {
  uint32_t cells = 0, nodes = 0;
  BufferSlice node_values;   // vec4 by node: position, value (< 0: inside; not NaN)
  BufferSlice corners;       // uint32 [cells][8]: nodes (cube_cases.h)
  BufferSlice cell_of_node;  // uint32 by node: the cube whose corner 0 it is, or no_cell
  BufferSlice cases;         // marching_case_words()
  BufferSlice marks;         // scratch, uint32 by cell
  BufferSlice block_counts;  // scratch, MeshCount [marching_blocks(cells)]
  BufferSlice places;        // scratch, MeshCount by cell
  BufferSlice total;         // out of the first call, MeshCount
};

// How many vertices and triangles there are. Throws std::invalid_argument for no cells or more than marching_most_cells.
void record_count_marched(Commands& commands, const MarchingCells& cells);
// After it, with total = what it gave. vertices: vec4 each, w = 1; triangles: three uint32 each, counter-clockwise seen from outside.
// A corner on an edge that begins at no cube's corner 0 is no_cell: sets of cubes that hold every cube that the surface crosses have none.
void record_march(Commands& commands, const MarchingCells& cells, const MeshCount& total, const BufferSlice& vertices, const BufferSlice& triangles);

}  // namespace arah
