#include "host/body/pose_blend.h"

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <numbers>
#include <random>

#include "tests/host/body/rigs.h"

namespace arah {
namespace {

constexpr double kPi = std::numbers::pi;

double angle_between(const glm::dvec3& a, const glm::dvec3& b) {
  return glm::length(axis_angle_from_rotation(glm::transpose(rotation_from_axis_angle(a)) * rotation_from_axis_angle(b)));
}

std::vector<std::pair<glm::dvec3, glm::dvec3>> pairs() {
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1, -2, 0.5)), other = glm::normalize(glm::dvec3(0.3, 1, 1));
  std::vector<std::pair<glm::dvec3, glm::dvec3>> all{
      {glm::dvec3(0.0), glm::dvec3(0.0)},  {glm::dvec3(0.0), kPi * axis},   {kPi * axis, -kPi * axis},          {kPi * axis, kPi * other},
      {glm::dvec3(0.0), 1e-8 * axis},      {1e-8 * axis, -1e-8 * axis},     {(kPi - 1e-7) * axis, -(kPi - 1e-7) * axis}, {10 * kPi * axis, 0.5 * other},
      {0.5 * kPi * axis, -0.5 * kPi * axis}};  // half a turn apart: antipodal
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> any(-3, 3);
  for (int i = 0; i < 500; ++i) all.push_back({{any(random), any(random), any(random)}, {any(random), any(random), any(random)}});
  return all;
}

TEST(PoseBlendTest, TakesTheShorterWayAtAnEvenPace) {
  for (const auto& [a, b] : pairs()) {
    const double whole = angle_between(a, b);
    ASSERT_LE(whole, kPi + 1e-12);
    for (const double weight : {0.1, 0.25, 0.5, 0.9}) {
      const glm::dvec3 between = blended_rotation(a, b, weight);
      // Rotations are apart by less than can be told of a cosine near 1.
      ASSERT_NEAR(angle_between(a, between), weight * whole, 3e-8);
      ASSERT_NEAR(angle_between(between, b), (1 - weight) * whole, 3e-8);
    }
  }
}

TEST(PoseBlendTest, EndsAreExact) {
  for (const auto& [a, b] : pairs()) {
    EXPECT_EQ(blended_rotation(a, b, 0), a);
    EXPECT_EQ(blended_rotation(a, b, 1), b);
  }
  const Pose one{{{10, 0, 0}, {0, 1, 0}}, {1, 2, 3}}, two{{{0, 0, 1}, {0, 1, 0}}, {3, 2, 1}};
  EXPECT_EQ(blended(one, two, 0), one);
  EXPECT_EQ(blended(one, two, 1), two);
  EXPECT_EQ(blended(one, two, -3), one);
  EXPECT_EQ(blended(one, two, 1e300), two);
  EXPECT_EQ(blended(one, two, 0.25).root_position, glm::dvec3(1.5, 2, 2.5));
  EXPECT_EQ(blended(one, two, 0.25).theta[1], glm::dvec3(0, 1, 0));  // alike in both: not rounded
}

TEST(PoseBlendTest, RefusesWhatHasNoBetween) {
  const Pose one{{{0, 0, 0}}, {}}, two{{{0, 0, 1}, {0, 1, 0}}, {}};
  EXPECT_THROW(blended(one, two, 0.5), std::invalid_argument);
  EXPECT_THROW(blended(one, one, std::nan("")), std::invalid_argument);
}

}  // namespace
}  // namespace arah
