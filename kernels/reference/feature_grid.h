// Dense grids of features over an axis-aligned box, one or several resolutions side by side, read by trilinear
// interpolation, in double precision.
//
// A level of nodes (nx, ny, nz) puts its first and last node of each axis on the faces of the box. Outside the box the
// value is that of the nearest point of the box; an axis with a single node is constant.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "kernels/reference/cube.h"

namespace arah::reference {

struct FeatureGridLevel {
  std::array<std::size_t, 3> nodes{1, 1, 1};  // along x, y, z
  std::size_t channels = 0;
  std::vector<double> features;  // [nz][ny][nx][channels]
};

struct FeatureGrid {
  Vec3 lower{-1, -1, -1};
  Vec3 upper{1, 1, 1};
  std::vector<FeatureGridLevel> levels;

  std::size_t channels() const;  // of all levels together
  FeatureGrid zeros() const;     // same shape, every feature 0
};

// x [points][3], in the units of the box -> [points][channels()], level after level. A NaN coordinate gives NaN. Throws
// std::invalid_argument when a size does not fit, a level has no node, or the box is empty along an axis.
std::vector<double> feature_grid_forward(const FeatureGrid& grid, std::size_t points, std::span<const double> x);

// Adds dL/dfeatures to `gradients` (shaped like the grid) unless it is null, and returns dL/dx [points][3]: 0 along an
// axis on which the point lies outside the box; on a node, the derivative towards the larger coordinate (towards the
// smaller one at the upper face).
std::vector<double> feature_grid_backward(const FeatureGrid& grid, std::size_t points, std::span<const double> x,
                                          std::span<const double> d_features, FeatureGrid* gradients);

}  // namespace arah::reference
