// Triangles of a zero set between the nodes of cubes, in double precision (kernels/meshing/marching_cubes.h).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace arah::reference {

struct CellNode {
  std::array<double, 3> position{};  // the caller's unit
  double value = 0;                  // < 0: inside
};

struct MarchedSurface {
  std::vector<std::array<double, 3>> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;  // counter-clockwise seen from outside
};

// corners: of each cube its eight nodes (cube_cases.h). Each edge that the surface crosses gets one vertex, where the value between the two
// nodes is 0, at least least_edge_part of the edge away from either. Cubes in their order; of each the vertices of the edges that begin at
// its corner 0 along x, y, z, and its triangles. Throws std::invalid_argument where a crossed edge begins at no cube's corner 0.
MarchedSurface marching_cubes(const std::vector<CellNode>& nodes, const std::vector<std::array<uint32_t, 8>>& corners);

}  // namespace arah::reference
