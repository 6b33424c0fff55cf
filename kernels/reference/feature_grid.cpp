#include "kernels/reference/feature_grid.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "kernels/reference/sizes.h"

namespace arah::reference {
namespace {

// The cell of a point along one axis: nodes `low` and `high` with weights 1 - t and t.
struct AxisCell {
  std::size_t low = 0;
  std::size_t high = 0;
  double t = 0;
  double slope = 0;  // dt/dx
};

AxisCell locate(double x, double lower, double upper, std::size_t nodes) {
  AxisCell cell;
  const double cells = static_cast<double>(nodes - 1);
  const double position = std::clamp((x - lower) / (upper - lower), 0.0, 1.0) * cells;  // clamp lets NaN through
  if (nodes > 1) {
    cell.low = std::isnan(position) ? 0 : std::min(static_cast<std::size_t>(position), nodes - 2);
    cell.high = cell.low + 1;
  }
  cell.t = position - static_cast<double>(cell.low);
  cell.slope = x >= lower && x <= upper ? cells / (upper - lower) : 0;
  return cell;
}

void check_grid(const FeatureGrid& grid, std::size_t points, std::span<const double> x) {
  check_size("feature grid: x", x.size(), points * 3);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(grid.lower[i] < grid.upper[i])) throw std::invalid_argument("feature grid: the box is empty along an axis");
  }
  for (const FeatureGridLevel& level : grid.levels) {
    const std::size_t nodes = level.nodes[0] * level.nodes[1] * level.nodes[2];
    if (nodes == 0) throw std::invalid_argument("feature grid: a level has no node");
    check_size("feature grid: features", level.features.size(), nodes * level.channels);
  }
}

// Calls visit(offset of the node's features, weight, dweight/dx) for the eight nodes around a point.
template <typename Visit>
void visit_nodes(const FeatureGrid& grid, const FeatureGridLevel& level, const double* x, const Visit& visit) {
  std::array<AxisCell, 3> cells;
  for (std::size_t i = 0; i < 3; ++i) cells[i] = locate(x[i], grid.lower[i], grid.upper[i], level.nodes[i]);
  for (std::size_t corner = 0; corner < 8; ++corner) {
    std::array<std::size_t, 3> node;
    Vec3 weight, slope;
    for (std::size_t i = 0; i < 3; ++i) {
      const bool high = (corner >> i & 1) != 0;
      node[i] = high ? cells[i].high : cells[i].low;
      weight[i] = high ? cells[i].t : 1 - cells[i].t;
      slope[i] = high ? cells[i].slope : -cells[i].slope;
    }
    const std::size_t index = (node[2] * level.nodes[1] + node[1]) * level.nodes[0] + node[0];
    visit(index * level.channels, weight[0] * weight[1] * weight[2],
          Vec3{slope[0] * weight[1] * weight[2], weight[0] * slope[1] * weight[2], weight[0] * weight[1] * slope[2]});
  }
}

}  // namespace

std::size_t FeatureGrid::channels() const {
  std::size_t sum = 0;
  for (const FeatureGridLevel& level : levels) sum += level.channels;
  return sum;
}

FeatureGrid FeatureGrid::zeros() const {
  FeatureGrid result = *this;
  for (FeatureGridLevel& level : result.levels) std::fill(level.features.begin(), level.features.end(), 0.0);
  return result;
}

std::vector<double> feature_grid_forward(const FeatureGrid& grid, std::size_t points, std::span<const double> x) {
  check_grid(grid, points, x);
  std::vector<double> output(points * grid.channels(), 0.0);
  std::size_t next = 0;
  for (std::size_t p = 0; p < points; ++p) {
    for (const FeatureGridLevel& level : grid.levels) {
      visit_nodes(grid, level, x.data() + p * 3, [&](std::size_t offset, double weight, const Vec3&) {
        for (std::size_t c = 0; c < level.channels; ++c) output[next + c] += weight * level.features[offset + c];
      });
      next += level.channels;
    }
  }
  return output;
}

std::vector<double> feature_grid_backward(const FeatureGrid& grid, std::size_t points, std::span<const double> x,
                                          std::span<const double> d_features, FeatureGrid* gradients) {
  check_grid(grid, points, x);
  check_size("feature grid backward: d_features", d_features.size(), points * grid.channels());
  std::vector<double> d_x(points * 3, 0.0);
  std::size_t next = 0;
  for (std::size_t p = 0; p < points; ++p) {
    for (std::size_t l = 0; l < grid.levels.size(); ++l) {
      const FeatureGridLevel& level = grid.levels[l];
      visit_nodes(grid, level, x.data() + p * 3, [&](std::size_t offset, double weight, const Vec3& slope) {
        for (std::size_t c = 0; c < level.channels; ++c) {
          const double d = d_features[next + c];
          if (gradients != nullptr) gradients->levels.at(l).features.at(offset + c) += d * weight;
          for (std::size_t i = 0; i < 3; ++i) d_x[p * 3 + i] += d * level.features[offset + c] * slope[i];
        }
      });
      next += level.channels;
    }
  }
  return d_x;
}

}  // namespace arah::reference
