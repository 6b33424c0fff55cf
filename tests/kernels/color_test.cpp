// The colour network's inputs and the feature grids against the double-precision truth.
#include "kernels/reference/color.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "kernels/color/assemble_inputs.h"
#include "kernels/color/feature_grid.h"
#include "kernels/reference/feature_grid.h"
#include "shaders/shared/frame.h"
#include "shaders/shared/ray.h"
#include "tests/kernels/closeness.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();

// Columns [first, first + count) of row-major float rows, as doubles.
std::vector<double> columns(const std::vector<float>& rows, size_t points, size_t stride, size_t first, size_t count) {
  std::vector<double> result;
  for (size_t p = 0; p < points; ++p)
    for (size_t c = 0; c < count; ++c) result.push_back(rows.at(p * stride + first + c));
  return result;
}

class ColorTest : public DeviceTest {
 protected:
  FrameConstants frame_constants() {
    FrameConstants frame{};
    frame.cube_scale = 0.93f;
    frame.cube_offset[0] = 0.11f;
    frame.cube_offset[1] = -0.27f;
    frame.cube_offset[2] = 0.05f;
    return frame;
  }
};

struct RowCase {
  ColorRow row;
  uint32_t rays, samples_per_ray, grid_channels, column;
  bool rotated = false;  // view directions, where the surface could be seen so

  // GoogleTest would print every byte, padding that nobody wrote among them.
  friend void PrintTo(const RowCase& c, std::ostream* out) {
    *out << c.rays << " rays of " << c.samples_per_ray << " samples, " << c.grid_channels << " grid channels from column " << c.column << (c.rotated ? ", rotated" : "");
  }
};

class ColorRows : public ColorTest, public testing::WithParamInterface<RowCase> {};

TEST_P(ColorRows, HoldTheirPartsInOrderAndHandGradientsBack) {
  const auto [row, ray_count, samples, grid_channels, column, rotated] = GetParam();
  const uint32_t points = ray_count * samples, padded = padded_points(points), padded_rays = padded_points(ray_count);
  const uint32_t channels = row.grid_column() + grid_channels;
  const uint32_t stride = column + padded_channels(channels) + 8,
                 feature_stride = padded_channels(row.feature_channels) + 16;

  const std::vector<float> canonical = uniform(padded * 4), normals = uniform(padded * 4, -3, 3),
                           features = uniform(padded * feature_stride);
  std::vector<Ray> rays(padded_rays);
  for (Ray& ray : rays) {
    const std::vector<float> direction = uniform(3);
    std::copy(direction.begin(), direction.end(), ray.direction);
    ray.near = ray.far = nan;
  }
  // Blends of rotations that partly cancel, far from singular but for the first three, which tell no direction.
  std::vector<float> transforms = uniform(padded * 12, -0.3, 0.3);
  for (size_t p = 0; p < padded; ++p)
    for (size_t i = 0; i < 3; ++i) transforms[12 * p + 5 * i] += 1;
  std::fill(transforms.begin(), transforms.begin() + 12, 0.0f);
  if (points > 2) {
    std::copy_n(transforms.begin() + 16, 4, transforms.begin() + 12);
    std::fill(transforms.begin() + 24, transforms.begin() + 36, nan);
  }
  // A turn of 120° about (1, 1, 1), and a little: some samples end behind their surface.
  const std::array<float, 9> rotation{0, 0.28f, 0.96f, 1, 0, 0, 0, 0.96f, -0.28f};
  const FrameConstants frame = frame_constants();
  Buffer transform_buffer = filled("transforms", transforms);
  Buffer frame_buffer = filled("frame", std::vector<FrameConstants>{frame}),
         canonical_buffer = filled("canonical", canonical);
  Buffer ray_buffer = filled("rays", rays), normal_buffer = filled("normals", normals),
         feature_buffer = filled("features", features);
  Buffer row_buffer = filled("rows", std::vector<float>(padded * stride, nan));

  AssembleInputsArgs args;
  args.row = row;
  args.points = points;
  args.samples_per_ray = samples;
  args.frame = frame_buffer.slice();
  args.canonical = canonical_buffer.slice();
  if (row.view) args.rays = ray_buffer.slice();
  if (row.normal || rotated) args.normals = normal_buffer.slice();
  if (row.canonical) args.transforms = transform_buffer.slice();
  if (rotated) args.view_rotation = rotation;
  if (row.feature_channels > 0) args.feature = {feature_buffer.slice(), feature_stride, 8};
  args.rows = {row_buffer.slice(), stride, column};
  args.channels = channels;
  record_assemble_inputs(commands, args);
  commands.submit_and_wait();
  const std::vector<float> rows = device.download<float>(row_buffer.slice());

  const std::vector<double> rotation_truth(rotated ? rotation.begin() : rotation.end(), rotation.end());
  std::vector<double> transforms_truth;
  for (uint32_t p = 0; p < points && row.canonical; ++p)
    for (uint32_t i = 0; i < 9; ++i) transforms_truth.push_back(transforms[12 * p + 4 * (i / 3) + i % 3]);
  const auto turn = [&](const std::vector<double>& towards_camera) {
    return reference::color_view(points, towards_camera, transforms_truth, rotation_truth, columns(normals, points, 4, 0, 3));
  };
  // 8 |v| of up to some 20, in float32, is the argument of a sine.
  const double tolerance = row.canonical || rotated ? 1e-5 : 3e-7;
  reference::ColorInputs inputs;
  for (uint32_t p = 0; p < points; ++p) {
    for (uint32_t i = 0; i < 3; ++i) {
      inputs.x.push_back(double(canonical[p * 4 + i]) * frame.cube_scale + frame.cube_offset[i]);
      if (row.view) inputs.view.push_back(-double(rays[p / samples].direction[i]));
      if (row.normal) inputs.normal.push_back(normals[p * 4 + i]);
    }
  }
  if (row.view) {
    const std::vector<double> towards_camera = inputs.view;
    inputs.view = turn(towards_camera);
    if (rotated && points > 64) {
      const std::vector<double> all = reference::color_view(points, towards_camera, transforms_truth, {}, {});
      uint32_t kept = 0;
      for (uint32_t p = 0; p < points; ++p) kept += inputs.view[3 * p] == all[3 * p];
      EXPECT_GT(kept, points / 4) << "views of surfaces that could not be seen so stay";
      EXPECT_LT(kept, 3 * points / 4);
    }
  }
  inputs.feature = columns(features, points, feature_stride, 8, row.feature_channels);
  inputs.grid.assign(size_t(points) * (padded_channels(channels) - row.grid_column()),
                     0.0);  // zeros up to the padded width
  expect_close("rows", columns(rows, points, stride, column, padded_channels(channels)),
               reference::color_input(points, inputs), tolerance);
  for (uint32_t p = 0; p < padded; ++p) {
    for (uint32_t c = 0; c < column; ++c)
      ASSERT_TRUE(std::isnan(rows[p * stride + c])) << "column " << c << " is not the kernel's";
    for (uint32_t c = column + padded_channels(channels); c < stride; ++c)
      ASSERT_TRUE(std::isnan(rows[p * stride + c])) << "column " << c;
  }

  // Rows of a queue: row p is sample points - 1 - p, whose ray alone depends on that.
  if (row.view) {
    std::vector<uint32_t> reversed(padded, 0);
    for (uint32_t p = 0; p < points; ++p) reversed[p] = points - 1 - p;
    Buffer sample_buffer = filled("samples", reversed);
    args.samples = sample_buffer.slice();
    args.sample_count = points;
    record_assemble_inputs(commands, args);
    commands.submit_and_wait();
    for (uint32_t p = 0; p < points; ++p)
      for (uint32_t i = 0; i < 3; ++i)
        inputs.view[3 * p + i] = -double(rays[reversed[p] / samples].direction[i]);
    inputs.view = turn(inputs.view);
    expect_close("rows of a queue",
                 columns(device.download<float>(row_buffer.slice()), points, stride, column, padded_channels(channels)),
                 reference::color_input(points, inputs), tolerance);
  }

  const std::vector<float> d_rows = uniform(padded * stride);
  Buffer d_row_buffer = filled("d rows", d_rows),
         d_position = filled("d position", std::vector<float>(padded * 4, nan));
  Buffer d_normal = filled("d normal", std::vector<float>(padded * 4, nan)),
         d_feature = filled("d feature", std::vector<float>(padded * feature_stride, nan));
  AssembleInputsBackwardArgs backward;
  backward.row = row;
  backward.points = points;
  backward.d_rows = {d_row_buffer.slice(), stride, column};
  backward.d_position = d_position.slice();
  if (row.normal) backward.d_normal = d_normal.slice();
  if (row.feature_channels > 0) backward.d_feature = {d_feature.slice(), feature_stride, 8};
  record_assemble_inputs_backward(commands, backward);
  commands.submit_and_wait();
  EXPECT_EQ(columns(device.download<float>(d_position.slice()), points, 4, 0, 3),
            columns(d_rows, points, stride, column, 3));
  if (row.normal) {
    EXPECT_EQ(columns(device.download<float>(d_normal.slice()), points, 4, 0, 3),
              columns(d_rows, points, stride, column + row.feature_column() - 3, 3));
  }
  if (row.feature_channels > 0) {
    const std::vector<float> found = device.download<float>(d_feature.slice());
    EXPECT_EQ(columns(found, points, feature_stride, 8, row.feature_channels),
              columns(d_rows, points, stride, column + row.feature_column(), row.feature_channels));
    const uint32_t padding = padded_channels(row.feature_channels) - row.feature_channels;
    EXPECT_EQ(columns(found, points, feature_stride, 8 + row.feature_channels, padding),
              std::vector<double>(size_t(points) * padding, 0.0));
    EXPECT_TRUE(std::isnan(found[0]) && std::isnan(found[8 + row.feature_channels + padding]))
        << "columns beside the feature are not the kernel's";
  }
}

// Every offset of the feature against the texels (33, 30, 6 and 3 columns before it), one point, more points than a
// workgroup, several samples a ray, features that fill no texel.
INSTANTIATE_TEST_SUITE_P(Parts, ColorRows,
                         testing::Values(RowCase{{true, true, 256}, 13, 5, 8, 0},
                                         RowCase{{true, false, 70}, 1, 1, 0, 8}, RowCase{{false, true, 5}, 65, 3, 4, 0},
                                         RowCase{{false, false, 33}, 63, 1, 0, 16},
                                         RowCase{{true, true, 0}, 200, 1, 0, 0},
                                         RowCase{{true, true, 256, true}, 13, 5, 8, 0},
                                         RowCase{{true, false, 70, true}, 65, 3, 0, 8},
                                         RowCase{{false, true, 5, true}, 65, 3, 4, 0},
                                         RowCase{{true, false, 33}, 66, 2, 0, 0, true},
                                         RowCase{{true, true, 70, true}, 200, 1, 4, 8, true},
                                         RowCase{{true, true, 5, true}, 1, 1, 0, 0, true}));

TEST_F(ColorTest, RefusesRowsThatAreTooNarrow) {
  AssembleInputsArgs args;
  args.row = {true, true, 256};
  args.points = 64;
  args.channels = 288;
  EXPECT_THROW(record_assemble_inputs(commands, args), std::invalid_argument);
  args.channels = 289;
  args.rows.stride = 288;
  EXPECT_THROW(record_assemble_inputs(commands, args), std::invalid_argument);
}

class FeatureGridTest : public ColorTest {
 protected:
  reference::FeatureGrid truth(const FeatureGridShape& shape, const std::vector<float>& features) {
    reference::FeatureGrid grid;
    for (size_t i = 0; i < 3; ++i) grid.lower[i] = shape.lower[i], grid.upper[i] = shape.upper[i];
    size_t next = 0;
    for (uint32_t l = 0; l < shape.levels; ++l) {
      const auto [x, y, z] = shape.nodes[l];
      const size_t count = size_t(x) * y * z * 4;
      grid.levels.push_back(
          {{x, y, z}, 4, std::vector<double>(features.begin() + long(next), features.begin() + long(next + count))});
      next += count;
    }
    return grid;
  }

  // Points in and around the box, none so near a node that rounding decides on which side it lies.
  std::vector<float> positions(const FeatureGridShape& shape, uint32_t count, double outside) {
    std::vector<float> result;
    while (result.size() < size_t(count) * 4) {
      std::vector<float> point = uniform(4);
      bool clear = true;
      for (size_t i = 0; i < 3; ++i) {
        const double middle = (double(shape.lower[i]) + shape.upper[i]) / 2,
                     half = (double(shape.upper[i]) - shape.lower[i]) / 2;
        point[i] = static_cast<float>(middle + point[i] * half * (1 + outside));
        for (uint32_t l = 0; l < shape.levels; ++l) {
          const double at = (point[i] - shape.lower[i]) / (2 * half) * (shape.nodes[l][i] - 1);
          clear = clear && (std::abs(at - std::round(at)) > 1e-4 || shape.nodes[l][i] == 1);
        }
        clear = clear && std::abs(point[i] - shape.lower[i]) > 1e-4 && std::abs(point[i] - shape.upper[i]) > 1e-4;
      }
      point[3] = nan;
      if (clear) result.insert(result.end(), point.begin(), point.end());
    }
    return result;
  }
};

struct GridCase {
  FeatureGridShape shape;
  uint32_t points, first_column;
  PositionGradient position_gradient;
};

class FeatureGrids : public FeatureGridTest, public testing::WithParamInterface<GridCase> {};

TEST_P(FeatureGrids, MatchTheTruthBothWays) {
  const auto [shape, points, first_column, position_gradient] = GetParam();
  const uint32_t padded = padded_points(points), stride = 8 + padded_channels(first_column + shape.channels());
  const std::vector<float> features = uniform(shape.feature_count()), x = positions(shape, padded, 0.3);
  Buffer feature_buffer = filled("features", features), position_buffer = filled("positions", x);
  Buffer row_buffer = filled("rows", std::vector<float>(padded * stride, nan));

  record_feature_grid_forward(
      commands,
      {shape, points, position_buffer.slice(), feature_buffer.slice(), {row_buffer.slice(), stride, 8}, first_column});
  commands.submit_and_wait();
  const std::vector<float> rows = device.download<float>(row_buffer.slice());
  const reference::FeatureGrid grid = truth(shape, features);
  const std::vector<double> x_truth = columns(x, points, 4, 0, 3);
  expect_close("features", columns(rows, points, stride, 8 + first_column, shape.channels()),
               reference::feature_grid_forward(grid, points, x_truth), 5e-6);
  for (uint32_t p = 0; p < padded; ++p) {
    for (uint32_t c = 0; c < stride; ++c) {
      const bool own = c >= 8 + first_column && c < 8 + first_column + shape.channels();
      ASSERT_EQ(std::isnan(rows[p * stride + c]), !own) << "point " << p << ", column " << c;
    }
  }

  const std::vector<float> d_rows = uniform(padded * stride), before = uniform(padded * 4);
  Buffer d_row_buffer = filled("d rows", d_rows), d_position = filled("d position", before);
  Buffer sums = filled("sums", std::vector<int32_t>(shape.feature_count())),
         clamped = filled("clamped", std::vector<uint32_t>(1));
  FeatureGridBackwardArgs args;
  args.shape = shape;
  args.points = points;
  args.max_contributions = points;
  args.scale =
      std::min(std::floor(2147483647.0f / float(points)), 16777216.0f) / 2;  // |d| ≤ 1 stays well below the limit
  args.positions = position_buffer.slice();
  args.features = feature_buffer.slice();
  args.d_rows = {d_row_buffer.slice(), stride, 8};
  args.first_column = first_column;
  args.sums = sums.slice();
  args.clamped = clamped.slice().elements(0, 1);
  args.position_gradient = position_gradient;
  if (position_gradient != PositionGradient::none) args.d_position = d_position.slice();
  args.position_factor = 0.5f;
  record_feature_grid_backward(commands, args);
  commands.submit_and_wait();

  reference::FeatureGrid d_grid = grid.zeros();
  std::vector<double> d_x = reference::feature_grid_backward(
      grid, points, x_truth, columns(d_rows, points, stride, 8 + first_column, shape.channels()), &d_grid);
  std::vector<double> d_features;
  for (const auto& level : d_grid.levels)
    d_features.insert(d_features.end(), level.features.begin(), level.features.end());
  std::vector<double> found;
  for (int32_t sum : device.download<int32_t>(sums.slice().elements(0, shape.feature_count())))
    found.push_back(sum / double(args.scale));
  // a node of a small grid gets a share of every point: float weights err by 1e-7 of a cell's position, sums by their
  // size
  double size = 1;
  for (double value : d_features) size = std::max(size, std::abs(value));
  expect_close("feature gradient", found, d_features, 2e-6 * size + 0.5 * points / args.scale);
  EXPECT_EQ(device.download<uint32_t>(clamped.slice().elements(0, 1))[0], 0u);

  const double weight = position_gradient == PositionGradient::none ? 0 : 0.5,
               kept = position_gradient == PositionGradient::assign ? 0 : 1;
  double largest = 1;
  for (size_t i = 0; i < d_x.size(); ++i) {
    largest = std::max(largest, std::abs(d_x[i]));
    d_x[i] = weight * d_x[i] + kept * before[i / 3 * 4 + i % 3];
  }
  expect_close("position gradient", columns(device.download<float>(d_position.slice()), points, 4, 0, 3), d_x,
               1e-5 * largest);
}

FeatureGridShape grid_shape(uint32_t levels) {
  return {{-0.5f, 0.25f, -2}, {1.5f, 1.25f, 3}, levels, {{{5, 7, 4}, {16, 11, 13}, {4, 1, 3}, {1, 1, 1}}}};
}

INSTANTIATE_TEST_SUITE_P(Shapes, FeatureGrids,
                         testing::Values(GridCase{grid_shape(2), 1000, 3, PositionGradient::assign},
                                         GridCase{grid_shape(4), 65, 1, PositionGradient::add},
                                         GridCase{grid_shape(1), 1, 8, PositionGradient::none}));

TEST_F(FeatureGridTest, CountsWhatItClampsAndNeverWraps) {
  // one node, all points: the sum of 200 contributions far above the limit stays just below 2^31
  const FeatureGridShape shape{{-1, -1, -1}, {1, 1, 1}, 1, {{{1, 1, 1}}}};
  const uint32_t points = 200;
  std::vector<float> x(padded_points(points) * 4, 0.25f), d(padded_points(points) * 8, 1e30f);
  for (uint32_t p = 0; p < points; ++p)
    d[p * 8 + 1] = -std::numeric_limits<float>::infinity(), d[p * 8 + 2] = 1, d[p * 8 + 3] = p == 7 ? nan : 0.5f;
  Buffer positions_buffer = filled("positions", x), features = filled("features", std::vector<float>(4)),
         d_rows = filled("d rows", d);
  Buffer sums = filled("sums", std::vector<int32_t>(4)), clamped = filled("clamped", std::vector<uint32_t>(1));
  FeatureGridBackwardArgs args;
  args.shape = shape;
  args.points = args.max_contributions = points;
  args.scale = 1024;
  args.positions = positions_buffer.slice();
  args.features = features.slice();
  args.d_rows = {d_rows.slice(), 8, 0};
  args.sums = sums.slice();
  args.clamped = clamped.slice();
  record_feature_grid_backward(commands, args);
  commands.submit_and_wait();
  const int32_t limit = 2147483647 / 200;
  EXPECT_EQ(device.download<int32_t>(sums.slice().elements(0, 4)),
            (std::vector<int32_t>{200 * limit, -200 * limit, 200 * 1024, 199 * 512}));
  EXPECT_EQ(device.download<uint32_t>(clamped.slice())[0], points);
}

TEST_F(FeatureGridTest, ShowsANaNPosition) {
  const FeatureGridShape shape = grid_shape(2);
  std::vector<float> x = positions(shape, 64, 0);
  x[4 * 3 + 1] = nan;
  const std::vector<float> all_features = uniform(shape.feature_count());
  Buffer positions_buffer = filled("positions", x), features = filled("features", all_features),
         rows = filled("rows", std::vector<float>(64 * 8));
  Buffer sums = filled("sums", std::vector<int32_t>(shape.feature_count())),
         clamped = filled("clamped", std::vector<uint32_t>(1));
  record_feature_grid_forward(commands,
                              {shape, 64, positions_buffer.slice(), features.slice(), {rows.slice(), 8, 0}, 0});
  FeatureGridBackwardArgs args;
  args.shape = shape;
  args.points = args.max_contributions = 64;
  args.scale = 1;
  args.positions = positions_buffer.slice();
  args.features = features.slice();
  args.d_rows = {rows.slice(), 8, 0};
  args.sums = sums.slice();
  args.clamped = clamped.slice();
  commands.submit_and_wait();
  const std::vector<float> found = device.download<float>(rows.slice());
  for (size_t i = 0; i < found.size(); ++i) EXPECT_EQ(std::isnan(found[i]), i / 8 == 3) << i;
  device.upload(rows.slice(), std::vector<float>(64 * 8, 1.0f));
  record_feature_grid_backward(commands, args);
  commands.submit_and_wait();
  EXPECT_EQ(device.download<uint32_t>(clamped.slice())[0], 2u) << "one point, two levels";
}

TEST_F(FeatureGridTest, RefusesShapesThatDoNotFit) {
  FeatureGridForwardArgs args;
  args.points = 1;
  args.rows.stride = 8;
  EXPECT_THROW(record_feature_grid_forward(commands, args), std::invalid_argument);  // no level
  args.shape = grid_shape(2);
  args.first_column = 1;
  EXPECT_THROW(record_feature_grid_forward(commands, args), std::invalid_argument);  // columns 1 to 9 of 8
  args.first_column = 0;
  args.shape.nodes[1][2] = 0;
  EXPECT_THROW(record_feature_grid_forward(commands, args), std::invalid_argument);
  args.shape = grid_shape(2);
  args.shape.upper[0] = args.shape.lower[0];
  EXPECT_THROW(record_feature_grid_forward(commands, args), std::invalid_argument);
}

}  // namespace
}  // namespace arah
