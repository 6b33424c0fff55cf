// Samples along rays, against double precision.
#include "kernels/reference/sampling.h"

#include <bit>
#include <cmath>

#include "kernels/linear/matrix.h"
#include "kernels/reference/random.h"
#include "kernels/sampling/least_distance.h"
#include "kernels/sampling/shell_samples.h"
#include "kernels/sampling/surface_samples.h"
#include "shaders/shared/ray.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

constexpr std::array<float, 3> translation{0.2F, -0.7F, 1.1F};

class Sampling : public DeviceTest {
 protected:
  std::vector<Ray> random_rays(uint32_t count) {
    std::vector<Ray> rays(count);
    for (Ray& ray : rays) {
      const auto n = uniform(8);
      const float size = std::sqrt(n[3] * n[3] + n[4] * n[4] + n[5] * n[5]);
      ray = {{n[0], n[1], n[2]}, 1.2F + 0.3F * n[6], {n[3] / size, n[4] / size, n[5] / size}, 3 + 0.4F * n[7]};
    }
    return rays;
  }
  static void expect_point(const float* point, const Ray& ray, double depth, size_t row) {
    for (size_t c = 0; c < 3; ++c)
      ASSERT_NEAR(point[c], double(ray.origin[c]) + depth * ray.direction[c] - translation[c], 2e-6) << row;
    ASSERT_EQ(point[3], 1) << row;
  }
};

TEST_F(Sampling, ShellSamplesFollowTheReference) {
  const struct {
    uint32_t rays, samples;
    bool jitter;
  } cases[] = {{1, 20, true}, {63, 10, true}, {65, 20, false}, {200, 7, true}, {3, 1, false}};
  for (const auto& shape : cases) {
    std::vector<Ray> rays = random_rays(shape.rays);
    std::vector<uint64_t> kept(shape.rays);
    for (uint64_t& bits : kept) bits = generator() & generator() & (generator() % 4 ? ~uint64_t(0) : 0);
    kept[0] = 0x8000000180000001;
    if (shape.rays > 2) {
      kept[1] = ~uint64_t(0);
      rays[2].far = -1;  // missed the box, whatever its bins say
    }
    const uint32_t rows = shape.rays * shape.samples, padded = padded_points(rows);
    Buffer r = filled("rays", rays), k = filled("kept", kept), z = empty("depths", padded * 4),
           delta = empty("deltas", padded * 4), points = empty("points", padded * 16);
    ShellSamplesArgs args;
    args.rays = shape.rays;
    args.samples = shape.samples;
    args.root_translation = translation;
    args.jitter = {shape.jitter, 11, 400, 5000};
    args.ray_list = r.slice();
    args.kept = k.slice();
    args.depths = z.slice();
    args.deltas = delta.slice();
    args.points = points.slice();
    record_shell_samples(commands, args);
    commands.submit_and_wait();
    const auto depths = device.download<float>(z.slice()), deltas = device.download<float>(delta.slice()),
               posed = device.download<float>(points.slice());
    size_t valid = 0;
    for (uint32_t ray = 0; ray < shape.rays; ++ray) {
      std::vector<double> random(shape.samples, 0.5), early, late;
      for (uint32_t j = 0; shape.jitter && j < shape.samples; ++j)
        random[j] = reference::random_unit(11, 400, 5000 + ray, j);
      for (double x : random) {
        early.push_back(x - 1e-5);
        late.push_back(x + 1e-5);
      }
      const int count = static_cast<int>(shape.samples);
      const auto truth = reference::shell_samples(rays[ray].near, rays[ray].far, kept[ray], count, random);
      // At the end of a run of bins single precision may put a sample just before or just after the gap.
      const auto before = reference::shell_samples(rays[ray].near, rays[ray].far, kept[ray], count, early);
      const auto after = reference::shell_samples(rays[ray].near, rays[ray].far, kept[ray], count, late);
      for (uint32_t j = 0; j < shape.samples; ++j) {
        const size_t row = ray * shape.samples + j;
        if (truth.depths.empty()) {
          ASSERT_EQ(depths[row], 0);
          ASSERT_EQ(deltas[row], 0);
          for (size_t c = 0; c < 4; ++c) ASSERT_EQ(posed[4 * row + c], 0);
          continue;
        }
        ++valid;
        const double error =
            std::min({std::abs(depths[row] - truth.depths[j]), std::abs(depths[row] - before.depths[j]),
                      std::abs(depths[row] - after.depths[j])});
        ASSERT_LT(error, 3e-6) << "ray " << ray << " sample " << j;
        ASSERT_NEAR(deltas[row], truth.delta, 1e-6);
        expect_point(&posed[4 * row], rays[ray], depths[row], row);
      }
    }
    EXPECT_GT(valid, 0u);
    EXPECT_TRUE(shape.rays < 3 || valid < rows);
    for (size_t row = rows; row < padded; ++row) EXPECT_EQ(posed[4 * row + 3], 0) << "padding";
  }
}

TEST_F(Sampling, SurfaceSamplesFollowTheReference) {
  for (const bool jittered : {false, true}) {
    for (const uint32_t count : {1u, 65u}) {
      std::vector<Ray> rays = random_rays(count);
      std::vector<float> solved(4 * count, 0.0F), surface(count);
      for (uint32_t i = 0; i < count; ++i) {
        solved[4 * i + 3] = generator() % 3 != 0;
        surface[i] = rays[i].near + 0.1F + uniform(1, 0, 1)[0] * (rays[i].far - rays[i].near - 0.1F);
      }
      solved[3] = 1;
      if (count > 3) {
        solved[4 + 3] = 1;
        surface[1] = rays[1].near + 0.02F;  // less than half_width behind near: the two sequences overlap
        solved[8 + 3] = 1;
        rays[2].far = -1;
        solved[12 + 3] = 0;
        surface[3] = NAN;  // nobody may look
      }
      SurfaceSamplesArgs args;
      args.rays = count;
      args.root_translation = translation;
      args.jitter = {jittered, 3, 17, 256};
      const uint32_t rows = count * args.slots, padded = padded_points(rows);
      Buffer r = filled("rays", rays), s = filled("surface points", solved), d = filled("surface depths", surface),
             z = empty("depths", padded * 4), points = empty("points", padded * 16);
      args.ray_list = r.slice();
      args.surface_points = s.slice();
      args.surface_depths = d.slice();
      args.depths = z.slice();
      args.points = points.slice();
      record_surface_samples(commands, args);
      commands.submit_and_wait();
      const auto depths = device.download<float>(z.slice()), posed = device.download<float>(points.slice());
      for (uint32_t ray = 0; ray < count; ++ray) {
        reference::RaySamples truth = solved[4 * ray + 3] != 0
                                          ? reference::surface_samples(rays[ray].near, surface[ray])
                                          : reference::uniform_samples(rays[ray].near, rays[ray].far);
        std::vector<double> random;
        for (uint32_t j = 0; j < truth.depths.size(); ++j)
          random.push_back(reference::random_unit(3, 17, 256 + ray, j));
        if (jittered) reference::jitter(truth, random);
        if (rays[ray].far < 0) truth = {};
        for (uint32_t slot = 0; slot < args.slots; ++slot) {
          const size_t row = ray * args.slots + slot;
          if (slot >= truth.depths.size()) {
            ASSERT_EQ(posed[4 * row + 3], 0) << "ray " << ray << " slot " << slot;
            ASSERT_EQ(depths[row], 0);
            continue;
          }
          ASSERT_NEAR(depths[row], truth.depths[slot], 2e-6) << "ray " << ray << " slot " << slot;
          if (static_cast<int>(slot) == truth.surface) {
            ASSERT_EQ(depths[row], surface[ray]) << "the surface is sampled exactly";
          }
          expect_point(&posed[4 * row], rays[ray], depths[row], row);
        }
      }
    }
  }
}

TEST_F(Sampling, TheLeastDistanceOfARayIsFound) {
  for (const auto& [rays, samples] : {std::pair{1u, 1u}, {65u, 100u}, {130u, 7u}}) {
    const uint32_t rows = rays * samples, stride = 16;
    std::vector<float> sdf(size_t(rows) * stride, -5.0F), points = uniform(4 * rows), f = uniform(rows);
    for (uint32_t row = 0; row < rows; ++row) {
      if (row % 11 == 3) f[row] = -0.5F;  // the first of several is taken
      sdf[size_t(row) * stride + 8] = f[row];
      const uint32_t ray = row / samples;
      points[4 * row + 3] = ray % 9 == 5 ? 0.0F : row % 3 == 0 ? 1.0F : row % 3 == 1 ? 0.0F : -1.0F;  // found, none, empty
    }
    Buffer d = filled("sdf", sdf), p = filled("points", points), least = filled("least", std::vector<float>(4 * padded_points(rays), 7));
    record_least_distance(commands, {rays, samples, {d.slice(), stride, 8}, p.slice(), least.slice()});
    commands.submit_and_wait();
    const auto found = device.download<float>(least.slice());
    for (uint32_t ray = 0; ray < padded_points(rays); ++ray) {
      std::vector<double> along;
      std::vector<uint8_t> counts;
      for (uint32_t k = 0; k < samples && ray < rays; ++k) along.push_back(f[ray * samples + k]), counts.push_back(points[4 * (ray * samples + k) + 3] > 0);
      const int truth = reference::least_distance(along, counts);
      const size_t row = truth < 0 ? 0 : ray * samples + static_cast<uint32_t>(truth);
      for (size_t c = 0; c < 3; ++c) ASSERT_EQ(found[4 * ray + c], truth < 0 ? 0 : points[4 * row + c]) << ray;
      ASSERT_EQ(found[4 * ray + 3], truth < 0 ? 0 : 1) << ray;
    }
  }
  // A distance that is no number must reach the optimiser's guard.
  Buffer d = filled("sdf", std::vector<float>{1, 0, 0, 0, NAN, 0, 0, 0, -1, 0, 0, 0}), p = filled("points", std::vector<float>{1, 1, 1, 1, 2, 2, 2, 1, 3, 3, 3, 1}), least = empty("least", 64 * 16);
  record_least_distance(commands, {1, 3, {d.slice(), 4, 0}, p.slice(), least.slice()});
  commands.submit_and_wait();
  EXPECT_EQ(device.download<float>(least.slice())[0], 2);
}

TEST_F(Sampling, SurfaceSamplesThatDoNotFitAreRefused) {
  SurfaceSamplesArgs args;
  args.rays = 1;
  args.slots = 32;
  EXPECT_THROW(record_surface_samples(commands, args), std::invalid_argument);
  args.slots = 64;
  args.around_surface = 16;
  EXPECT_THROW(record_surface_samples(commands, args), std::invalid_argument);
}

}  // namespace
}  // namespace arah
