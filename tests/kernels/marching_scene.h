// Fields at the nodes of a box, and the cubes between these that their zero set crosses.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "kernels/reference/marching_cubes.h"

namespace arah::reference {

struct MarchingScene {
  std::array<int, 3> size;  // nodes along each axis
  std::vector<CellNode> nodes;
  std::vector<std::array<uint32_t, 8>> corners;

  template <typename Field>
  MarchingScene(const std::array<int, 3>& across, double cell, const Field& field) : size(across) {
    for (int z = 0; z < size[2]; ++z)
      for (int y = 0; y < size[1]; ++y)
        for (int x = 0; x < size[0]; ++x) {
          const std::array<double, 3> p{x * cell, y * cell, z * cell};
          nodes.push_back({p, field(p)});
        }
    gather();
  }

  // Puts the box's faces outside.
  void close() {
    for (int z = 0; z < size[2]; ++z)
      for (int y = 0; y < size[1]; ++y)
        for (int x = 0; x < size[0]; ++x)
          if (x == 0 || y == 0 || z == 0 || x + 1 == size[0] || y + 1 == size[1] || z + 1 == size[2]) nodes[node(x, y, z)].value = 1;
    gather();
  }

  // Leaves out one cube that a vertex of others' triangles lies in.
  void make_a_hole() {
    corners.erase(std::find_if(corners.begin(), corners.end(), [&](const auto& cell) { return (nodes[cell[0]].value < 0) != (nodes[cell[1]].value < 0); }));
  }

  // By node the cube whose corner 0 it is, or ~0.
  std::vector<uint32_t> cell_of_node() const {
    std::vector<uint32_t> cells(nodes.size(), ~0u);
    for (uint32_t c = 0; c < corners.size(); ++c) cells[corners[c][0]] = c;
    return cells;
  }

 private:
  uint32_t node(int x, int y, int z) const { return static_cast<uint32_t>((z * size[1] + y) * size[0] + x); }
  void gather() {
    corners.clear();
    for (int z = 0; z + 1 < size[2]; ++z)
      for (int y = 0; y + 1 < size[1]; ++y)
        for (int x = 0; x + 1 < size[0]; ++x) {
          std::array<uint32_t, 8> cell{};
          int inside = 0;
          for (int i = 0; i < 8; ++i) {
            cell[static_cast<size_t>(i)] = node(x + (i & 1), y + (i >> 1 & 1), z + (i >> 2));
            inside += nodes[cell[static_cast<size_t>(i)]].value < 0;
          }
          if (inside > 0 && inside < 8) corners.push_back(cell);
        }
  }
};

}  // namespace arah::reference
