#include "host/avatar/grid_extent.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr double kMostFeatures = double{1 << 27} / sizeof(float);
constexpr double kRounding = 1e-6;  // cells: an extent that is whole up to rounding takes no further cell

}  // namespace

GridExtent make_grid_extent(const AvatarSpec& spec, std::span<const glm::dvec3> canonical_vertices) {
  GridExtent grid;
  if (spec.grid_cells.empty()) return grid;
  glm::dvec3 lower = canonical_vertices.front(), upper = lower;
  for (const glm::dvec3& vertex : canonical_vertices) {
    lower = glm::min(lower, vertex);
    upper = glm::max(upper, vertex);
  }
  const double coarsest = *std::max_element(spec.grid_cells.begin(), spec.grid_cells.end());
  const glm::dvec3 middle = 0.5 * (lower + upper);
  const glm::dvec3 cells = glm::ceil((upper - lower + 2.0 * kGridMargin) / coarsest - kRounding);
  const glm::dvec3 extent = coarsest * cells;
  grid.lower = glm::vec3(middle - 0.5 * extent);
  grid.upper = glm::vec3(middle + 0.5 * extent);
  double features = 0;
  for (double cell : spec.grid_cells) {
    const glm::dvec3 nodes = glm::ceil(extent / cell - kRounding) + 1.0;
    features += nodes.x * nodes.y * nodes.z * kGridFeatures;
    if (!(features <= kMostFeatures)) {
      throw InputError("feature grid", fmt::format("cells of {} m", cell),
                       fmt::format("at most {:.0f} numbers in all levels (128 MiB)", kMostFeatures),
                       fmt::format("{:.3g} for a body of {:.3g} x {:.3g} x {:.3g} m", features, upper.x - lower.x,
                                   upper.y - lower.y, upper.z - lower.z),
                       "Choose larger cells in grid_cells, or an empty list for no grid.");
    }
    grid.nodes.emplace_back(nodes);
  }
  return grid;
}

}  // namespace arah
