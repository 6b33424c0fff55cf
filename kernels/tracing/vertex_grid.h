// A uniform grid over the posed template's vertices, in which record_nearest_vertex searches. Built by the host, once a
// frame; no Vulkan here.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace arah {

// Cell (x, y, z) has the number (z · cells[1] + y) · cells[0] + x and begins at origin + cell_size · (x, y, z).
struct VertexGrid {
  std::array<float, 3> origin{};  // metres, the vertices' space
  float cell_size = 1;            // metres
  std::array<uint32_t, 3> cells{1, 1, 1};
  std::vector<std::array<float, 4>> vertices;  // sorted by cell, then by index: position, index (exact in a float)
  std::vector<uint32_t> cell_start;            // [cells + 1]: where a cell's vertices begin in `vertices`
  std::vector<uint32_t> cell_seed;             // [cells]: place in `vertices` of one near the cell's centre
};

inline constexpr uint32_t vertex_grid_most_cells = 64;  // along an axis: the shader's loops stay below 65,535 rounds
inline constexpr uint32_t vertex_grid_most_vertices = 1u << 24;

// `cells_along_longest` (1 to vertex_grid_most_cells) cells along the longest side of the vertices' box, cubic ones.
// Throws std::invalid_argument without vertices, with too many, with one that is not finite, or with a bad number of
// cells.
VertexGrid build_vertex_grid(std::span<const std::array<float, 3>> vertices, uint32_t cells_along_longest = 40);

}  // namespace arah
