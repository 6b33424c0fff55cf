// Rotations of view directions: as often as asked for, true rotations, of angles as the paper draws them.
#include "host/training/view_augmentation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace arah {
namespace {

TEST(ViewAugmentation, DrawsRotationsAsOftenAsAskedFor) {
  std::mt19937_64 generator(1);
  int drawn = 0;
  for (int i = 0; i < 4000; ++i) {
    const auto rotation = draw_view_rotation(0.25, generator);
    if (!rotation) continue;
    drawn += 1;
    for (size_t a = 0; a < 3; ++a)
      for (size_t b = 0; b < 3; ++b) {
        double product = 0;
        for (size_t i3 = 0; i3 < 3; ++i3) product += double((*rotation)[3 * a + i3]) * (*rotation)[3 * b + i3];
        ASSERT_NEAR(product, a == b, 1e-6) << "rows " << a << " and " << b;
      }
    const auto& r = *rotation;
    ASSERT_NEAR(r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) + r[2] * (r[3] * r[7] - r[4] * r[6]), 1, 1e-6) << "no reflection";
  }
  EXPECT_NEAR(drawn, 1000, 4 * std::sqrt(4000 * 0.25 * 0.75));
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(draw_view_rotation(0, generator));
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(draw_view_rotation(1, generator));
}

// R = R_x(roll) R_y(pitch) R_z(yaw) has sin pitch in its corner, and sines and cosines of roll and yaw times cos pitch beside
// it. Of a normal angle with deviation s, sin² is (1 - exp(-2 s²)) / 2 in the mean, and the mean cosine exp(-s² / 2).
TEST(ViewAugmentation, AnglesHaveADeviationOf45Degrees) {
  std::mt19937_64 generator(2);
  constexpr int draws = 40000;
  const double s = std::numbers::pi / 4, squared_sine = 0.5 * (1 - std::exp(-2 * s * s)), squared_cosine = 1 - squared_sine, cosine = std::exp(-0.5 * s * s);
  double pitch = 0, roll = 0, yaw = 0, cosines_yaw = 0, cosines_roll = 0, sines = 0;
  for (int i = 0; i < draws; ++i) {
    const auto r = *draw_view_rotation(1, generator);
    pitch += std::pow(double(r[2]), 2) / draws, sines += double(r[2]) / draws;
    roll += std::pow(double(r[5]), 2) / draws, yaw += std::pow(double(r[1]), 2) / draws;
    cosines_yaw += double(r[0]) / draws, cosines_roll += double(r[8]) / draws;
  }
  const double error = 4 / std::sqrt(double(draws));
  EXPECT_NEAR(pitch, squared_sine, error);
  EXPECT_NEAR(sines, 0, error);
  EXPECT_NEAR(roll, squared_sine * squared_cosine, error);
  EXPECT_NEAR(yaw, squared_sine * squared_cosine, error);
  EXPECT_NEAR(cosines_yaw, cosine * cosine, error);
  EXPECT_NEAR(cosines_roll, cosine * cosine, error);
}

}  // namespace
}  // namespace arah
