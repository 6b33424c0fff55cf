#include "kernels/tracing/vertex_grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace arah {
namespace {

constexpr uint32_t none = ~0u;

float squared_distance(const std::array<float, 4>& vertex, const std::array<float, 3>& point) {
  float sum = 0;
  for (size_t i = 0; i < 3; ++i) sum += (vertex[i] - point[i]) * (vertex[i] - point[i]);
  return sum;
}

// Gives every cell a vertex near its centre: that of a neighbour where none of its own is nearer, passed on in two
// sweeps through the grid, forward from the 13 neighbours before a cell and back from the 13 after it. The first sweep
// fills the rest of the row, plane and grid after an occupied cell, up to a wedge that the second one closes with all
// before it.
void spread_seeds(VertexGrid& grid) {
  const auto size = [&](size_t axis) { return static_cast<int>(grid.cells[axis]); };
  const auto number = [&](int x, int y, int z) { return static_cast<size_t>((z * size(1) + y) * size(0) + x); };
  const auto sweep = [&](int direction) {
    const auto along = [&](int step, int length) { return direction > 0 ? step : length - 1 - step; };
    for (int k = 0; k < size(2); ++k)
      for (int j = 0; j < size(1); ++j)
        for (int i = 0; i < size(0); ++i) {
          const int x = along(i, size(0)), y = along(j, size(1)), z = along(k, size(2));
          const std::array<float, 3> centre{grid.origin[0] + grid.cell_size * (static_cast<float>(x) + 0.5f),
                                            grid.origin[1] + grid.cell_size * (static_cast<float>(y) + 0.5f),
                                            grid.origin[2] + grid.cell_size * (static_cast<float>(z) + 0.5f)};
          uint32_t& seed = grid.cell_seed[number(x, y, z)];
          float best =
              seed == none ? std::numeric_limits<float>::infinity() : squared_distance(grid.vertices[seed], centre);
          for (int before = 0; before < 13; ++before) {  // (dx, dy, dz) in {−1, 0, 1}³, those before (0, 0, 0)
            const int nx = x + direction * (before % 3 - 1), ny = y + direction * (before / 3 % 3 - 1);
            const int nz = z + direction * (before / 9 - 1);
            if (nx < 0 || ny < 0 || nz < 0 || nx >= size(0) || ny >= size(1) || nz >= size(2)) continue;
            const uint32_t candidate = grid.cell_seed[number(nx, ny, nz)];
            if (candidate == none) continue;
            const float distance = squared_distance(grid.vertices[candidate], centre);
            if (distance < best) {
              best = distance;
              seed = candidate;
            }
          }
        }
  };
  sweep(1);
  sweep(-1);
}

}  // namespace

VertexGrid build_vertex_grid(std::span<const std::array<float, 3>> vertices, uint32_t cells_along_longest) {
  if (vertices.empty() || vertices.size() > vertex_grid_most_vertices)
    throw std::invalid_argument(
        fmt::format("vertex grid: {} vertices, expected 1 to {}", vertices.size(), vertex_grid_most_vertices));
  if (cells_along_longest == 0 || cells_along_longest > vertex_grid_most_cells)
    throw std::invalid_argument(fmt::format("vertex grid: {} cells along the longest side, expected 1 to {}",
                                            cells_along_longest, vertex_grid_most_cells));
  VertexGrid grid;
  std::array<float, 3> low = vertices[0], high = vertices[0];
  for (size_t v = 0; v < vertices.size(); ++v)
    for (size_t i = 0; i < 3; ++i) {
      if (!std::isfinite(vertices[v][i]))
        throw std::invalid_argument(fmt::format("vertex grid: vertex {} is not finite", v));
      low[i] = std::min(low[i], vertices[v][i]);
      high[i] = std::max(high[i], vertices[v][i]);
    }
  const float longest = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
  grid.origin = low;
  grid.cell_size = longest > 0 ? longest / static_cast<float>(cells_along_longest) : 1.0f;
  size_t cell_count = 1;
  for (size_t i = 0; i < 3; ++i) {
    const float needed = std::floor((high[i] - low[i]) / grid.cell_size) + 1;
    grid.cells[i] = static_cast<uint32_t>(std::clamp(needed, 1.0f, static_cast<float>(cells_along_longest)));
    cell_count *= grid.cells[i];
  }

  // Counting sort by cell; within a cell the indices stay in order.
  std::vector<uint32_t> cell_of(vertices.size());
  grid.cell_start.assign(cell_count + 1, 0);
  for (size_t v = 0; v < vertices.size(); ++v) {
    uint32_t number = 0;
    for (size_t i = 3; i-- > 0;) {
      const float place = (vertices[v][i] - grid.origin[i]) / grid.cell_size;
      number = number * grid.cells[i] + std::min(static_cast<uint32_t>(std::max(place, 0.0f)), grid.cells[i] - 1);
    }
    cell_of[v] = number;
    ++grid.cell_start[number + 1];
  }
  for (size_t c = 0; c < cell_count; ++c) grid.cell_start[c + 1] += grid.cell_start[c];
  std::vector<uint32_t> next(grid.cell_start.begin(), grid.cell_start.end() - 1);
  grid.vertices.resize(vertices.size());
  grid.cell_seed.assign(cell_count, none);
  for (size_t v = 0; v < vertices.size(); ++v) {
    const uint32_t place = next[cell_of[v]]++;
    grid.vertices[place] = {vertices[v][0], vertices[v][1], vertices[v][2], static_cast<float>(v)};
    grid.cell_seed[cell_of[v]] = grid.cell_start[cell_of[v]];
  }
  spread_seeds(grid);
  return grid;
}

}  // namespace arah
