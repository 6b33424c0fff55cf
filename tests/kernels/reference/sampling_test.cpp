#include "kernels/reference/sampling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "kernels/reference/random.h"
#include "tests/golden.h"

namespace arah::reference {
namespace {

std::vector<double> random_numbers(std::size_t count, std::uint32_t ray) {
  std::vector<double> numbers;
  for (std::uint32_t i = 0; i < count; ++i) numbers.push_back(random_unit(1, 2, ray, i));
  return numbers;
}

TEST(SurfaceSamples, SeventeenAroundAndSixteenBefore) {
  const RaySamples samples = surface_samples(1, 2.5);
  ASSERT_EQ(samples.depths.size(), 33u);
  EXPECT_TRUE(std::is_sorted(samples.depths.begin(), samples.depths.end()));
  EXPECT_EQ(samples.depths[samples.surface], 2.5);
  EXPECT_EQ(samples.surface, 16 + 8);
  EXPECT_NEAR(samples.depths[1] - samples.depths[0], 1.45 / 15, 1e-12);
  EXPECT_EQ(samples.depths[0], 1);
  EXPECT_NEAR(samples.depths[15], 2.45, 1e-12);  // the last one before and the first one around coincide
  EXPECT_NEAR(samples.depths[16], 2.45, 1e-12);
  for (int i = 17; i < 33; ++i) EXPECT_NEAR(samples.depths[i] - samples.depths[i - 1], 0.00625, 1e-12);
  EXPECT_NEAR(samples.depths[32], 2.55, 1e-12);
}

TEST(SurfaceSamples, SurfaceCloserToNearThanTheInterval) {
  // near lies inside the ±5 cm: the sixteen crowd on 1e-5 m behind near, between samples around the surface, and these
  // reach in front of near.
  const RaySamples samples = surface_samples(1, 1.02);
  EXPECT_TRUE(std::is_sorted(samples.depths.begin(), samples.depths.end()));
  EXPECT_EQ(samples.depths[samples.surface], 1.02);
  EXPECT_NEAR(samples.depths.front(), 0.97, 1e-12);
  EXPECT_EQ(std::count_if(samples.depths.begin(), samples.depths.end(),
                          [](double z) { return z >= 1 && z <= 1.00001 + 1e-12; }),
            16);
  // The surface at near: every sample before it counts as in front.
  const RaySamples at_near = surface_samples(1, 1);
  EXPECT_EQ(at_near.depths[at_near.surface], 1);
  EXPECT_EQ(at_near.surface, 8 + 1);
}

TEST(SurfaceSamples, OddCounts) {
  const RaySamples samples = surface_samples(0.5, 0.9, {0.1, 3, 2});
  ASSERT_EQ(samples.depths.size(), 5u);
  EXPECT_EQ(samples.surface, 3);
  const std::vector<double> expected{0.5, 0.8, 0.8, 0.9, 1.0};
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(samples.depths[i], expected[i], 1e-12);
  const RaySamples single = surface_samples(0.5, 0.9, {0.1, 1, 1});
  EXPECT_EQ(single.depths, (std::vector<double>{0.5, 0.9}));
  EXPECT_EQ(single.surface, 1);
}

TEST(UniformSamples, EndsIncluded) {
  const RaySamples samples = uniform_samples(2, 4.5);
  ASSERT_EQ(samples.depths.size(), 64u);
  EXPECT_EQ(samples.depths.front(), 2);
  EXPECT_EQ(samples.depths.back(), 4.5);
  EXPECT_NEAR(samples.depths[1], 2 + 2.5 / 63, 1e-12);
  EXPECT_EQ(samples.surface, kNoSurfaceSample);
  EXPECT_EQ(uniform_samples(2, 3, 1).depths, std::vector<double>{2});
}

TEST(Samples, Golden12) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("12_step");
  const auto near_far = truth.values("in.near_far"), depths = truth.values("full.d"), z = truth.values("in.samples.z");
  const auto hit = truth.integers("in.samples.hit");
  std::vector<double> found, expected;
  for (std::size_t i = 0; i < depths.size(); ++i) {
    const double near = near_far[2 * i], far = near_far[2 * i + 1];
    const RaySamples samples = hit[i] ? surface_samples(near, depths[i]) : uniform_samples(near, far);
    for (std::size_t j = 0; j < samples.depths.size(); ++j) {  // a hit's further slots are unused
      found.push_back(samples.depths[j]);
      expected.push_back(z[64 * i + j]);
    }
  }
  golden::expect_close("sample depths", found, expected, golden::double_limit(truth, "in.samples.z"));
}

TEST(Jitter, StaysBetweenMidpointsAndKeepsTheSurface) {
  for (std::uint32_t ray = 0; ray < 50; ++ray) {
    const RaySamples before = ray % 2 ? surface_samples(1, 1.01 + 0.02 * ray) : uniform_samples(1, 2, 7);
    RaySamples after = before;
    jitter(after, random_numbers(before.depths.size(), ray));
    EXPECT_EQ(after.surface, before.surface);
    EXPECT_TRUE(std::is_sorted(after.depths.begin(), after.depths.end()));
    if (before.surface != kNoSurfaceSample) {
      EXPECT_EQ(after.depths[after.surface], before.depths[before.surface]);
    }
    int moved = 0;
    for (std::size_t i = 0; i < before.depths.size(); ++i) {
      if (i > 0) {
        EXPECT_GE(after.depths[i], (before.depths[i - 1] + before.depths[i]) / 2);
      }
      if (i + 1 < before.depths.size()) {
        EXPECT_LE(after.depths[i], (before.depths[i] + before.depths[i + 1]) / 2);
      }
      EXPECT_GE(after.depths[i], before.depths.front());
      EXPECT_LE(after.depths[i], before.depths.back());
      moved += after.depths[i] != before.depths[i];
    }
    EXPECT_GE(moved, static_cast<int>(before.depths.size()) - 3);
  }
}

TEST(Jitter, ZeroRandomIsTheLowerMidpoint) {
  RaySamples samples = uniform_samples(0, 4, 5);
  jitter(samples, std::vector<double>(5, 0.0));
  EXPECT_EQ(samples.depths, (std::vector<double>{0, 0.5, 1.5, 2.5, 3.5}));
  RaySamples single = uniform_samples(3, 4, 1);
  jitter(single, std::vector<double>(1, 0.7));
  EXPECT_EQ(single.depths, std::vector<double>{3});
}

TEST(ShellSamples, StratifiedOverTheUnionOfTheKeptBins) {
  // Bins 3, 4 and 60 of 64 over 6.4 m: bins of 10 cm, a union of 30 cm.
  const std::uint64_t kept = 1ull << 3 | 1ull << 4 | 1ull << 60;
  for (std::uint32_t ray = 0; ray < 20; ++ray) {
    const int count = 3 + static_cast<int>(ray % 7);
    const ShellSamples samples = shell_samples(1, 7.4, kept, count, random_numbers(count, ray));
    ASSERT_EQ(static_cast<int>(samples.depths.size()), count);
    EXPECT_NEAR(samples.delta * count, 0.3, 1e-12);
    for (int j = 0; j < count; ++j) {
      // Depth to position along the union, and from it the stratum.
      const double z = samples.depths[j];
      const bool front = z >= 1.3 - 1e-12 && z <= 1.5 + 1e-12;
      EXPECT_TRUE(front || (z >= 7.0 - 1e-12 && z <= 7.1 + 1e-12)) << z;
      const double position = front ? z - 1.3 : 0.2 + z - 7.0;
      EXPECT_GE(position, j * 0.3 / count - 1e-12);
      EXPECT_LE(position, (j + 1) * 0.3 / count + 1e-12);
    }
    EXPECT_TRUE(std::is_sorted(samples.depths.begin(), samples.depths.end()));
  }
}

TEST(ShellSamples, EveryBinKeptIsStratifiedSamplingOfTheRay) {
  const std::vector<double> random = random_numbers(20, 5);
  const ShellSamples samples = shell_samples(2, 3, ~0ull, 20, random);
  EXPECT_NEAR(samples.delta, 0.05, 1e-15);
  for (int j = 0; j < 20; ++j) EXPECT_NEAR(samples.depths[j], 2 + (j + random[j]) / 20, 1e-12);
}

TEST(ShellSamples, LastBinAndNothingKept) {
  const double almost_one = std::nextafter(1.0, 0.0);
  const ShellSamples last = shell_samples(0, 64, 1ull << 63, 1, std::vector<double>{almost_one});
  EXPECT_EQ(last.delta, 1);
  EXPECT_GE(last.depths[0], 63);
  EXPECT_LE(last.depths[0], 64);
  EXPECT_TRUE(shell_samples(0, 1, 0, 5, std::vector<double>(5)).depths.empty());
  EXPECT_TRUE(shell_samples(1, 1, ~0ull, 5, std::vector<double>(5)).depths.empty());
  EXPECT_EQ(shell_samples(1, 1, ~0ull, 5, std::vector<double>(5)).delta, 0);
}

}  // namespace
}  // namespace arah::reference
