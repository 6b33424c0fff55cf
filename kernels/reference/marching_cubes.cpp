#include "kernels/reference/marching_cubes.h"

#include <algorithm>
#include <map>
#include <stdexcept>

#include "kernels/meshing/cube_cases.h"

namespace arah::reference {

MarchedSurface marching_cubes(const std::vector<CellNode>& nodes, const std::vector<std::array<uint32_t, 8>>& corners) {
  MarchedSurface surface;
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> vertex_of_edge;  // by the node where it begins and its axis
  for (const auto& cell : corners)
    for (uint32_t axis = 0; axis < 3; ++axis) {
      const CellNode &low = nodes[cell[0]], &high = nodes[cell[1u << axis]];
      if ((low.value < 0) == (high.value < 0)) continue;
      const double t = std::clamp(low.value / (low.value - high.value), least_edge_part, 1 - least_edge_part);
      vertex_of_edge[{cell[0], axis}] = static_cast<uint32_t>(surface.vertices.size());
      auto& vertex = surface.vertices.emplace_back();
      for (size_t k = 0; k < 3; ++k) vertex[k] = low.position[k] + t * (high.position[k] - low.position[k]);
    }
  for (const auto& cell : corners) {
    uint32_t inside = 0;
    for (uint32_t i = 0; i < 8; ++i) inside |= nodes[cell[i]].value < 0 ? 1u << i : 0;
    const CubeCase cut = cube_case(inside);
    for (size_t triangle = 0; triangle < cut.triangles; ++triangle) {
      auto& at = surface.triangles.emplace_back();
      for (size_t k = 0; k < 3; ++k) {
        const uint32_t edge = cut.edges[3 * triangle + k];
        const auto found = vertex_of_edge.find({cell[cube_edge_corner(edge)], cube_edge_axis(edge)});
        if (found == vertex_of_edge.end()) throw std::invalid_argument("marching cubes: an edge that the surface crosses begins at no cube's first corner");
        at[k] = found->second;
      }
    }
  }
  return surface;
}

}  // namespace arah::reference
