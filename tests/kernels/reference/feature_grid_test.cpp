#include "kernels/reference/feature_grid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/kernels/reference/finite_differences.h"

namespace arah::reference {
namespace {

// Two levels of odd, unequal sizes, and one that is a single node.
FeatureGrid small_grid() {
  FeatureGrid grid;
  grid.lower = {-0.5, 0.25, -2};
  grid.upper = {1.5, 1.25, 3};
  grid.levels.push_back({{3, 2, 5}, 2, random_values(3 * 2 * 5 * 2, 1, 1)});
  grid.levels.push_back({{4, 1, 3}, 3, random_values(4 * 1 * 3 * 3, 1, 2)});
  grid.levels.push_back({{1, 1, 1}, 1, {0.75}});
  return grid;
}

TEST(FeatureGrid, ReproducesALinearField) {
  FeatureGrid grid{{-1, 0, 2}, {1, 3, 4}, {{{4, 3, 6}, 1, {}}}};
  const auto field = [](double x, double y, double z) { return 2 * x - 3 * y + 0.5 * z + 7; };
  for (std::size_t k = 0; k < 6; ++k) {
    for (std::size_t j = 0; j < 3; ++j) {
      for (std::size_t i = 0; i < 4; ++i) {
        grid.levels[0].features.push_back(field(-1 + 2 * double(i) / 3, 3 * double(j) / 2, 2 + 2 * double(k) / 5));
      }
    }
  }
  const std::vector<double> x = {0.1, 1.7, 2.9, -1, 0, 2, 1, 3, 4, 0.33, 2.999, 3.4};
  const std::vector<double> values = feature_grid_forward(grid, 4, x);
  const std::vector<double> d_x = feature_grid_backward(grid, 4, x, std::vector<double>(4, 1.0), nullptr);
  for (std::size_t p = 0; p < 4; ++p) {
    EXPECT_NEAR(values[p], field(x[p * 3], x[p * 3 + 1], x[p * 3 + 2]), 1e-13) << p;
    EXPECT_NEAR(d_x[p * 3], 2, 1e-12) << p;
    EXPECT_NEAR(d_x[p * 3 + 1], -3, 1e-12) << p;
    EXPECT_NEAR(d_x[p * 3 + 2], 0.5, 1e-12) << p;
  }
}

TEST(FeatureGrid, BackwardMatchesFiniteDifferences) {
  FeatureGrid grid = small_grid();
  const std::size_t points = 5;
  // inside, inside, outside along x, outside along y and z, at a large distance
  std::vector<double> x = {0.13, 0.4, 0.6, 1.31, 1.1, -1.3, 1.9, 0.7, 2.2, 0.8, -3, 5, -400, 0.9, 1.7};
  const std::vector<double> weights = random_values(points * grid.channels(), 1, 3);
  const auto loss = [&] { return dot(weights, feature_grid_forward(grid, points, x)); };
  FeatureGrid gradients = grid.zeros();
  const std::vector<double> d_x = feature_grid_backward(grid, points, x, weights, &gradients);
  expect_gradient("grid x", loss, x, d_x);
  for (std::size_t l = 0; l < grid.levels.size(); ++l) {
    expect_gradient("grid level " + std::to_string(l), loss, grid.levels[l].features, gradients.levels[l].features);
  }
}

TEST(FeatureGrid, KeepsTheBorderOutside) {
  const FeatureGrid grid = small_grid();
  const double far = std::numeric_limits<double>::max();
  const std::vector<double> outside = {far, -far, 0.5, -std::numeric_limits<double>::infinity(), 9, 0.5};
  const std::vector<double> border = {1.5, 0.25, 0.5, -0.5, 1.25, 0.5};
  EXPECT_EQ(feature_grid_forward(grid, 2, outside), feature_grid_forward(grid, 2, border));
  const std::vector<double> d_x =
      feature_grid_backward(grid, 2, outside, std::vector<double>(2 * grid.channels(), 1.0), nullptr);
  EXPECT_EQ(d_x[0], 0);
  EXPECT_EQ(d_x[1], 0);
  EXPECT_NE(d_x[2], 0);
}

TEST(FeatureGrid, PassesNaNOn) {
  const FeatureGrid grid = small_grid();
  for (double value : feature_grid_forward(grid, 1, std::vector<double>{std::nan(""), 0.5, 0.5})) {
    EXPECT_TRUE(std::isnan(value));
  }
}

TEST(FeatureGrid, RefusesWhatDoesNotFit) {
  FeatureGrid grid = small_grid();
  EXPECT_THROW(feature_grid_forward(grid, 2, std::vector<double>(3)), std::invalid_argument);
  grid.levels[0].features.pop_back();
  EXPECT_THROW(feature_grid_forward(grid, 1, std::vector<double>(3)), std::invalid_argument);
  grid = small_grid();
  grid.upper[1] = grid.lower[1];
  EXPECT_THROW(feature_grid_forward(grid, 1, std::vector<double>(3)), std::invalid_argument);
  grid = small_grid();
  grid.levels[0].nodes[2] = 0;
  EXPECT_THROW(feature_grid_forward(grid, 1, std::vector<double>(3)), std::invalid_argument);
}

}  // namespace
}  // namespace arah::reference
