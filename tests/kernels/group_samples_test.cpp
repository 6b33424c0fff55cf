// Groups of samples that share one colour: their choice, and compositing by them, against double precision.
#include "kernels/compositing/group_samples.h"

#include <algorithm>
#include <cmath>

#include "kernels/compositing/forward.h"
#include "kernels/reference/compositing.h"
#include "kernels/reference/density.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

constexpr float near = 0.02F;

class GroupSamples : public DeviceTest {
 protected:
  // Canonical points that wander along a ray in steps of some 6 mm, with a jump to another part of the body here and there.
  std::vector<float> wandering(uint32_t rays, uint32_t samples) {
    std::vector<float> points;
    for (uint32_t ray = 0; ray < rays; ++ray) {
      std::vector<float> at = uniform(3, -0.5, 0.5);
      for (uint32_t k = 0; k < samples; ++k) {
        const std::vector<float> step = uniform(3, -0.006, 0.006);
        for (size_t c = 0; c < 3; ++c) at[c] += step[c] + (k == samples / 2 && ray % 3 == 0 ? 0.1F : 0.0F);
        points.insert(points.end(), {at[0], at[1], at[2], 1});
      }
    }
    return points;
  }
  static std::vector<std::array<double, 3>> points_of(const std::vector<float>& points, size_t first, uint32_t samples) {
    std::vector<std::array<double, 3>> result;
    for (size_t row = first; row < first + samples; ++row) result.push_back({points[4 * row], points[4 * row + 1], points[4 * row + 2]});
    return result;
  }
};

TEST_F(GroupSamples, FollowTheReference) {
  for (const uint32_t rays : {1u, 63u, 65u, 300u})
    for (const uint32_t groups : {1u, 2u, 5u}) {
      const uint32_t samples = 20, rows = rays * samples;
      const float least = groups == 2 ? 0.02F : 0.0F;
      std::vector<float> weights = uniform(rows, -0.05, 0.1);
      for (float& weight : weights) weight = std::max(weight, 0.0F);
      std::fill_n(weights.begin(), samples, 0.0F);  // the first ray sees nothing
      const std::vector<float> points = wandering(rays, samples);
      Buffer weight_rows = filled("weights", weights), point_rows = filled("points", points), flags = filled("flags", std::vector<uint32_t>(rows, 7));
      record_group_samples(commands, {rays, samples, groups, least, near, weight_rows.slice(), point_rows.slice(), flags.slice()});
      commands.submit_and_wait();
      const std::vector<float> moved = device.download<float>(point_rows.slice());
      const std::vector<uint32_t> flagged = device.download<uint32_t>(flags.slice());
      double largest = 0;
      size_t found = 0, undecided = 0;
      for (uint32_t ray = 0; ray < rays; ++ray) {
        const size_t first = size_t(ray) * samples;
        const std::vector<double> wide(weights.begin() + static_cast<ptrdiff_t>(first), weights.begin() + static_cast<ptrdiff_t>(first + samples));
        std::vector<uint32_t> begins(samples, 0);
        const auto expected = reference::group_samples(wide, points_of(points, first, samples), groups, double{least}, double{near});
        for (const auto& group : expected) begins[group.first] = 1;
        if (!std::equal(begins.begin(), begins.end(), &flagged[first])) {  // only where rounding decides which part a sample lies in
          ++undecided;
          continue;
        }
        for (const auto& group : expected) {
          const size_t row = first + group.first;
          for (size_t c = 0; c < 3; ++c) largest = std::max(largest, std::abs(moved[4 * row + c] - group.point[c]));
          EXPECT_EQ(moved[4 * row + 3], 1);
        }
        for (uint32_t k = 0; k < samples; ++k)
          for (size_t c = 0; c < 4 && !begins[k]; ++c) EXPECT_EQ(moved[4 * (first + k) + c], points[4 * (first + k) + c]) << "a point that begins no group moved";
        found += expected.size();
      }
      EXPECT_LE(largest, 2e-7);  // rounding of a coordinate below 1 m, and of a shift below 2 cm
      EXPECT_LE(undecided, 1u);
      EXPECT_TRUE(rays == 1 ? found == 0 : found >= size_t(rays) - 1 - undecided);
    }
}

TEST_F(GroupSamples, GiveTheirColourToTheSamplesAfterThem) {
  const uint32_t rays = 65, samples = 20, rows = rays * samples;
  std::vector<float> sdf(4 * padded_points(rows), 0), points = wandering(rays, samples), depths(rows), deltas(padded_points(rows), 0.004F);
  const float b = 0.01F;
  const std::vector<float> values = uniform(rows, -0.02, 0.04);
  for (uint32_t row = 0; row < rows; ++row) {
    sdf[4 * row] = values[row];
    depths[row] = 2 + 0.004F * static_cast<float>(row % samples);
  }
  points.resize(4 * padded_points(rows), 0);
  Buffer sdf_rows = filled("sdf", sdf), point_rows = filled("points", points), depth_rows = filled("depths", depths), delta_rows = filled("deltas", deltas),
         parameters = filled("parameters", std::vector<float>{b}), colors = empty("colours", padded_points(rays) * 16), ray_depths = empty("ray depths", padded_points(rays) * 4),
         weights = empty("weights", padded_points(rows) * 4), transmittances = empty("transmittances", padded_points(rows) * 4), flags = empty("flags", rows * 4);
  CompositeForwardArgs forward;
  forward.samples.rays = rays;
  forward.samples.samples = samples;
  forward.samples.sdf = {sdf_rows.slice(), 4, 0};
  forward.samples.points = point_rows.slice();
  forward.samples.deltas = delta_rows.slice();
  forward.samples.parameters = parameters.slice();
  forward.depths = depth_rows.slice();
  forward.colors = colors.slice();
  forward.ray_depths = ray_depths.slice();
  forward.weights = weights.slice();
  forward.transmittances = transmittances.slice();
  forward.flags = flags.slice();
  record_composite_forward(commands, forward);
  record_group_samples(commands, {rays, samples, 2, 0.01F, near, weights.slice(), point_rows.slice(), flags.slice()});
  commands.submit_and_wait();
  const std::vector<uint32_t> flagged = device.download<uint32_t>(flags.slice().elements(0, rows));
  std::vector<uint32_t> slots(rows, no_slot);
  std::vector<float> rgb;
  for (uint32_t row = 0; row < rows; ++row) {
    if (!flagged[row]) continue;
    slots[row] = static_cast<uint32_t>(rgb.size() / 4);
    const std::vector<float> color = uniform(3, 0, 1);
    rgb.insert(rgb.end(), {color[0], color[1], color[2], 0});
  }
  const auto queued = static_cast<uint32_t>(rgb.size() / 4);
  ASSERT_GT(queued, rays);
  rgb.resize(4 * padded_points(queued), NAN);
  Buffer slot_rows = filled("slots", slots), rgb_rows = filled("rgb", rgb);
  forward.flags = {};
  forward.samples.rgb = {rgb_rows.slice(), 4, 0};
  forward.samples.slots = slot_rows.slice();
  forward.samples.slot_count = queued;
  forward.samples.groups = true;
  record_composite_forward(commands, forward);
  commands.submit_and_wait();
  const std::vector<float> color = device.download<float>(colors.slice());
  double largest = 0;
  for (uint32_t ray = 0; ray < rays; ++ray) {
    std::vector<double> wide, delta(samples, double{0.004F}), depth;
    std::vector<std::array<double, 3>> of_samples;
    std::array<double, 3> current{};  // black before the first group
    for (uint32_t row = ray * samples; row < (ray + 1) * samples; ++row) {
      if (slots[row] != no_slot) current = {rgb[4 * slots[row]], rgb[4 * slots[row] + 1], rgb[4 * slots[row] + 2]};
      wide.push_back(values[row]);
      depth.push_back(depths[row]);
      of_samples.push_back(current);
    }
    const std::vector<uint8_t> mask(samples, 1);
    const reference::Composite truth = reference::composite({wide, delta, depth, of_samples, mask, reference::laplace_scale(b)});
    for (size_t c = 0; c < 3; ++c) largest = std::max(largest, std::abs(color[4 * ray + c] - truth.colour[c]));
  }
  std::printf("  largest difference of a colour %.1e\n", largest);
  EXPECT_LE(largest, 2e-6);
}

}  // namespace
}  // namespace arah
