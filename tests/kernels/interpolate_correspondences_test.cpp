// Correspondences from a grid against the double-precision truth, where the grid can tell and where it cannot.
#include "kernels/tracing/interpolate_correspondences.h"

#include <cmath>

#include "kernels/reference/tracing.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

using Vector3 = reference::Vector<3>;

class InterpolateCorrespondences : public DeviceTest {};

TEST_F(InterpolateCorrespondences, FollowTheReference) {
  const uint32_t nodes[3] = {7, 5, 6}, count = 7 * 5 * 6, points = 1003;
  const float cell = 0.025f, longest = 0.06f;
  const std::array<float, 3> origin{-0.1f, 0.2f, 1.0f};
  // A smooth map; a part of the nodes has none; beyond a plane it jumps to another part of the body.
  std::vector<Vector3> canonical(count);
  std::vector<uint8_t> found(count);
  std::vector<uint32_t> slots(count, 0);
  std::vector<float> rows{0, 0, 0, 0};
  for (uint32_t node = 0; node < count; ++node) {
    const uint32_t x = node % nodes[0], y = node / nodes[0] % nodes[1], z = node / (nodes[0] * nodes[1]);
    const double p[3] = {origin[0] + cell * x, origin[1] + cell * y, origin[2] + cell * z};
    for (int c = 0; c < 3; ++c) canonical[node][c] = static_cast<float>(p[c] + 0.02 * std::sin(9 * p[(c + 1) % 3]) + (x > 4 ? 0.3 : 0));
    found[node] = generator() % 20 != 0;
    const bool has_slot = found[node] || node % 2 == 0;  // some that were not found have a place all the same
    if (!has_slot) continue;
    slots[node] = static_cast<uint32_t>(rows.size() / 4);
    for (int c = 0; c < 3; ++c) rows.push_back(found[node] ? static_cast<float>(canonical[node][c]) : NAN);
    rows.push_back(found[node]);
  }
  std::vector<float> targets;
  for (uint32_t p = 0; p < points; ++p) {
    const std::vector<float> in_cells = uniform(3, -0.3, 1.0);
    for (int c = 0; c < 3; ++c) targets.push_back(origin[static_cast<size_t>(c)] + cell * float(nodes[c]) * in_cells[static_cast<size_t>(c)]);
    targets.push_back(p % 11 == 0 ? 0.0f : 1.0f);
  }
  targets[4 * 5] = NAN;
  for (int c = 0; c < 3; ++c) targets[4 * 6 + static_cast<size_t>(c)] = origin[static_cast<size_t>(c)];  // at the first node

  Buffer target_rows = filled("targets", targets), slot_rows = filled("slots", slots), canonical_rows = filled("canonical", rows),
         result = filled("result", std::vector<float>(padded_points(points) * 4, 7)), flags = filled("flags", std::vector<uint32_t>(padded_points(points), 7));
  CorrespondenceNodes grid{{origin, cell, {nodes[0], nodes[1], nodes[2]}}, longest, slot_rows.slice(), canonical_rows.slice()};
  record_interpolate_correspondences(commands, {points, target_rows.slice(), grid, result.slice(), flags.slice()});
  commands.submit_and_wait();
  const std::vector<float> interpolated = device.download<float>(result.slice());
  const std::vector<uint32_t> flagged = device.download<uint32_t>(flags.slice());

  const reference::CorrespondenceNodes truth{{origin[0], origin[1], origin[2]}, cell, {nodes[0], nodes[1], nodes[2]}, canonical, found, longest};
  uint32_t told = 0, untold = 0, at_edges = 0;
  double largest = 0;
  for (uint32_t p = 0; p < points; ++p) {
    const Vector3 q{targets[4 * p], targets[4 * p + 1], targets[4 * p + 2]};
    const bool wanted = targets[4 * p + 3] > 0;
    const auto expected = reference::interpolate_correspondence(q, truth);
    const bool has = interpolated[4 * p + 3] > 0;
    EXPECT_EQ(flagged[p], wanted && !has ? 1u : 0u) << p;
    for (size_t c = 0; c < 4 && !has; ++c) EXPECT_EQ(interpolated[4 * p + c], 0) << p;
    EXPECT_TRUE(wanted || !has) << p;
    if (!wanted) continue;
    if (expected.has_value() != has) {  // only where rounding decides which cell a point lies in
      ++at_edges;
      continue;
    }
    ++(has ? told : untold);
    if (!has) continue;
    EXPECT_EQ(interpolated[4 * p + 3], 1);
    for (size_t c = 0; c < 3; ++c) largest = std::max(largest, std::abs(interpolated[4 * p + c] - (*expected)[static_cast<int>(c)]));
  }
  std::printf("  %u of %u points from the grid, largest error %.2e m, %u undecided by rounding\n", told, told + untold, largest, at_edges);
  EXPECT_LE(largest, 4e-6);  // a point's place in its cell has an error of 1e-7 of its coordinate, 40 cells
  EXPECT_GT(told, 100u);
  EXPECT_GT(untold, 100u);
  EXPECT_LE(at_edges, 2u);
  for (uint32_t p = points; p < padded_points(points); ++p) EXPECT_EQ(flagged[p], 0u);
}

}  // namespace
}  // namespace arah
