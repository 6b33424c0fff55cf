// Distances from a grid against the double-precision truth, inside the grid, on its faces and outside.
#include "kernels/tracing/interpolate_distances.h"

#include <cmath>

#include "kernels/reference/tracing.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

class InterpolateDistances : public DeviceTest {};

TEST_F(InterpolateDistances, FollowTheReference) {
  for (const uint32_t rows : {1u, 63u, 65u, 1000u}) {
    const ShellGrid grid{{-0.1f, 0.2f, 1.0f}, 0.006f, {9, 6, 7}};  // 378 nodes: not a multiple of 4 either
    std::vector<float> values = uniform(9 * 6 * 7, -0.02, 0.02), points;
    reference::ValueNodes truth{{grid.origin[0], grid.origin[1], grid.origin[2]}, grid.cell, {9, 6, 7}, {values.begin(), values.end()}};
    values.resize(padded_points(9 * 6 * 7), 0);
    for (uint32_t row = 0; row < rows; ++row) {
      const std::vector<float> place = uniform(3, -0.2, 1.2);
      for (size_t axis = 0; axis < 3; ++axis) points.push_back(grid.origin[axis] + grid.cell * static_cast<float>(grid.nodes[axis] - 1) * place[axis]);
      points.push_back(1);
    }
    for (size_t axis = 0; axis < 3; ++axis) points[axis] = grid.origin[axis] + grid.cell * static_cast<float>(grid.nodes[axis] - 1);  // the last node
    points.resize(padded_points(rows) * 4, 0);
    Buffer point_rows = filled("points", points), nodes = filled("nodes", values), result = filled("result", std::vector<float>(padded_points(rows) * 4, 7));
    record_interpolate_distances(commands, {rows, point_rows.slice(), {grid, nodes.slice()}, result.slice()});
    commands.submit_and_wait();
    const std::vector<float> interpolated = device.download<float>(result.slice());
    double largest = 0;
    for (uint32_t row = 0; row < rows; ++row)
      largest = std::max(largest, std::abs(interpolated[4 * row] - reference::interpolate_value({points[4 * row], points[4 * row + 1], points[4 * row + 2]}, truth)));
    std::printf("  %u rows: largest error %.1e\n", rows, largest);
    // A place in its cell has an error of 1.2e-7 of its coordinate, 200 cells; values of neighbours differ by 0.04 at most.
    EXPECT_LE(largest, 3 * 200 * 1.2e-7 * 0.04);
    for (size_t i = 4 * rows; i < interpolated.size(); ++i) EXPECT_EQ(interpolated[i], 0);
  }
}

}  // namespace
}  // namespace arah
