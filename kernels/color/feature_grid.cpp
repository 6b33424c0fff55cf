#include "kernels/color/feature_grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "shaders/shared/feature_grid.h"

namespace arah {
namespace {

constexpr uint32_t workgroup = 64;

struct GridConstants {
  FeatureGridBox box;
  FeatureGridLevel levels[FeatureGridShape::max_levels];
};

void check_shape(const FeatureGridShape& shape) {
  const auto refuse = [](const std::string& text) { return std::invalid_argument("feature grid: " + text); };
  if (shape.levels == 0 || shape.levels > FeatureGridShape::max_levels)
    throw refuse(fmt::format("{} levels, 1 to {} are possible", shape.levels, FeatureGridShape::max_levels));
  for (size_t i = 0; i < 3; ++i)
    if (!(shape.lower[i] < shape.upper[i]))
      throw refuse(fmt::format("box from {} to {} along axis {}", shape.lower[i], shape.upper[i], i));
  for (uint32_t l = 0; l < shape.levels; ++l)
    if (shape.nodes[l][0] == 0 || shape.nodes[l][1] == 0 || shape.nodes[l][2] == 0)
      throw refuse(fmt::format("level {} has no node", l));
  if (shape.feature_count() > uint64_t(std::numeric_limits<int32_t>::max()))
    throw refuse(fmt::format("{} features, at most {} are possible", shape.feature_count(),
                             std::numeric_limits<int32_t>::max()));
}

void check_columns(const FeatureGridShape& shape, const Matrix& rows, uint32_t first_column) {
  if (rows.column + first_column + shape.channels() > rows.stride)
    throw std::invalid_argument(fmt::format("feature grid: columns {} to {} do not fit rows of {}",
                                            rows.column + first_column, rows.column + first_column + shape.channels(),
                                            rows.stride));
}

void check_scale(float scale) {
  if (!(scale > 0) || !std::isfinite(scale))
    throw std::invalid_argument(fmt::format("feature grid: scale {}, a positive number is needed", scale));
}

GridConstants grid_constants(const FeatureGridShape& shape) {
  GridConstants constants{};
  for (size_t i = 0; i < 3; ++i) {
    constants.box.lower[i] = shape.lower[i];
    constants.box.inverse_size[i] = 1 / (shape.upper[i] - shape.lower[i]);
  }
  uint32_t first = 0;
  for (uint32_t l = 0; l < shape.levels; ++l) {
    const auto [x, y, z] = shape.nodes[l];
    constants.levels[l] = {x, y, z, first};
    first += x * y * z;
  }
  return constants;
}

uint64_t row_bytes(const Matrix& rows, uint32_t points) {
  return uint64_t(padded_points(points)) * rows.stride * 4;
}

}  // namespace

uint64_t FeatureGridShape::node_count() const {
  uint64_t sum = 0;
  for (uint32_t l = 0; l < levels; ++l) sum += uint64_t(nodes[l][0]) * nodes[l][1] * nodes[l][2];
  return sum;
}

void record_feature_grid_forward(Commands& commands, const FeatureGridForwardArgs& args) {
  check_shape(args.shape);
  check_columns(args.shape, args.rows, args.first_column);
  struct {
    GridConstants grid;
    uint32_t row_stride, first_column;
  } const constants{grid_constants(args.shape), args.rows.stride, args.rows.column + args.first_column};
  const uint64_t points = padded_points(args.points);

  Launch launch;
  launch.pipeline = &commands.device().pipeline("color/feature_grid_forward", {args.shape.levels});
  launch.name = "feature grid";
  launch.groups = {static_cast<uint32_t>(points / workgroup), 1, 1};
  launch.bindings = {{args.positions, points * 16},
                     {args.features, args.shape.feature_count() * 4},
                     {args.rows.slice, row_bytes(args.rows, args.points)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  const double nodes_read = 8.0 * static_cast<double>(points) * args.shape.levels;
  launch.cost = {nodes_read * 11, 16.0 * static_cast<double>(points) + table_bytes(nodes_read * 16, 4.0 * static_cast<double>(args.shape.feature_count())) +
                                      4.0 * static_cast<double>(points) * args.shape.channels()};
  commands.dispatch(launch);
}

void record_feature_grid_backward(Commands& commands, const FeatureGridBackwardArgs& args) {
  check_shape(args.shape);
  check_columns(args.shape, args.d_rows, args.first_column);
  check_scale(args.scale);
  if (args.max_contributions < args.points)
    throw std::invalid_argument(fmt::format("feature grid: {} points contribute, at most {} were announced",
                                            args.points, args.max_contributions));
  const uint32_t column = args.d_rows.column + args.first_column;
  const uint32_t limit =
      args.max_contributions == 0 ? 0 : uint32_t(std::numeric_limits<int32_t>::max()) / args.max_contributions;
  // 2^24: above it a float no longer holds every integer, and rounding up could pass the limit
  const uint32_t exact_limit = std::min(limit, 1u << 24);
  struct {
    GridConstants grid;
    uint32_t row_stride, first_texel, count;
    float scale, limit, position_factor;
  } const constants{grid_constants(args.shape),      args.d_rows.stride / 4, column / 4, args.points, args.scale,
                    static_cast<float>(exact_limit), args.position_factor};
  const uint64_t points = padded_points(args.points);
  const bool position = args.position_gradient != PositionGradient::none;

  Launch launch;
  launch.pipeline = &commands.device().pipeline(
      "color/feature_grid_backward", {args.shape.levels, column % 4, static_cast<uint32_t>(args.position_gradient)});
  launch.name = "feature grid backward";
  launch.groups = {static_cast<uint32_t>(points / workgroup), 1, 1};
  launch.bindings = {{args.positions, points * 16},
                     {args.features, args.shape.feature_count() * 4},
                     {args.d_rows.slice, row_bytes(args.d_rows, args.points)},
                     {args.sums, args.shape.feature_count() * 4},
                     {args.clamped, 4},
                     position ? Binding{args.d_position, points * 16} : Binding{args.sums}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  const double nodes_touched = 8.0 * static_cast<double>(points) * args.shape.levels;
  launch.cost = {nodes_touched * (position ? 26 : 11), 16.0 * static_cast<double>(points) * (position ? 2 : 1) +
                                                           table_bytes(nodes_touched * 16, 4.0 * static_cast<double>(args.shape.feature_count())) * (position ? 3 : 2) +
                                                           4.0 * static_cast<double>(points) * args.shape.channels()};
  commands.dispatch(launch);
}

}  // namespace arah
