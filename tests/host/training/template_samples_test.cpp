// The pools of points around the template must keep what their comments promise.
#include "host/training/template_samples.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "host/body/mesh_distance.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

constexpr double float_metres = 1e-6;  // rounding of positions of some metres to float
constexpr size_t stride = 16;          // every so many points of a pool are looked at

struct Drawn {
  Avatar avatar = make_avatar(small_spec(), small_capture(), 3);
  std::vector<glm::dvec3> vertices = canonical_vertices(avatar.body, avatar.canonical);
  MeshDistance distance{vertices, avatar.body.triangles};
  TemplateSamples samples = draw_template_samples(avatar, 3);
};
const Drawn& drawn() {
  static const Drawn all;
  return all;
}

TEST(TemplateSamplesTest, DistancesAreThoseOfTheTemplate) {
  const Drawn& d = drawn();
  glm::dvec3 lower(d.vertices.front()), upper = lower;
  for (const glm::dvec3& v : d.vertices) lower = glm::min(lower, v), upper = glm::max(upper, v);
  size_t inside = 0, close = 0, seen = 0;
  for (size_t i = 0; i < d.samples.near.size(); i += stride, ++seen) {
    const DistanceSample& s = d.samples.near[i];
    ASSERT_NEAR(d.distance.closest(s.position).signed_distance, s.signed_distance, float_metres) << i;
    inside += s.signed_distance < 0;
    close += std::abs(s.signed_distance) < 0.05;
  }
  EXPECT_GT(seen, 1000u);
  EXPECT_GT(inside, seen / 5);
  EXPECT_LT(inside, seen * 4 / 5);
  EXPECT_GT(close, seen * 3 / 4);
  glm::dvec3 least(upper), most(lower);
  for (size_t i = 0; i < d.samples.volume.size(); i += stride) {
    const DistanceSample& s = d.samples.volume[i];
    ASSERT_NEAR(d.distance.closest(s.position).signed_distance, s.signed_distance, float_metres) << i;
    least = glm::min(least, glm::dvec3(s.position)), most = glm::max(most, glm::dvec3(s.position));
  }
  for (int axis = 0; axis < 3; ++axis) {
    // within the bounds grown by 15 cm, and up to their ends
    EXPECT_GE(least[axis], lower[axis] - 0.15 - float_metres);
    EXPECT_LE(most[axis], upper[axis] + 0.15 + float_metres);
    EXPECT_LT(least[axis], lower[axis] - 0.14);
    EXPECT_GT(most[axis], upper[axis] + 0.14);
  }
}

TEST(TemplateSamplesTest, PointsOffTheSurfaceAreFarAndInsidePointsAreDeepAndInNoHand) {
  const Drawn& d = drawn();
  ASSERT_GE(d.samples.off_surface.size(), 256u);
  for (size_t i = 0; i < d.samples.off_surface.size(); i += stride) {
    ASSERT_GT(d.distance.closest(d.samples.off_surface[i]).signed_distance, 0.20 - float_metres) << i;
    const glm::dvec3 n = d.avatar.cube.to_cube(d.samples.off_surface[i]);
    for (int axis = 0; axis < 3; ++axis) ASSERT_LE(std::abs(n[axis]), 1 + 1e-6) << i;
  }
  ASSERT_GE(d.samples.inside.size(), 256u);
  for (size_t i = 0; i < d.samples.inside.size(); i += stride) {
    const ClosestPoint closest = d.distance.closest(d.samples.inside[i]);
    ASSERT_LT(closest.signed_distance, -0.01 + float_metres) << i;
    const uint32_t corner = d.avatar.body.triangles[closest.triangle].x;
    double hand = 0;
    for (int k = 0; k < 4; ++k)
      if (d.avatar.body.skeleton.names[d.avatar.body.joints[corner][k]].find("hand") != std::string::npos)
        hand += d.avatar.body.weights[corner][k];
    ASSERT_LT(hand, 0.99) << i;  // wholly the hand's: the interpolated weights' largest would be, too
  }
}

TEST(TemplateSamplesTest, WeightsAreThoseOfTheClosestSurfacePoint) {
  const Drawn& d = drawn();
  const auto expect_weights = [&](const WeightSample& s) {
    const ClosestPoint closest = d.distance.closest(s.position);
    std::array<double, 256> truth{};
    const glm::uvec3 corners = d.avatar.body.triangles[closest.triangle];
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 4; ++k)
        truth[d.avatar.body.joints[corners[c]][k]] += closest.barycentric[c] * d.avatar.body.weights[corners[c]][k];
    double sum = 0, kept = 0;
    for (size_t k = 0; k < 4; ++k) {
      const float weight = s.weights[static_cast<int>(k)];
      EXPECT_GE(weight, 0);
      sum += weight;
      kept += weight > 0 ? truth[s.joints[k]] : 0;
    }
    EXPECT_NEAR(sum, 1, 1e-6);
    for (size_t k = 0; k < 4; ++k) {
      const double weight = s.weights[static_cast<int>(k)];
      // a rounded position near an edge may have its closest point on the neighbouring triangle: the same weights there
      EXPECT_NEAR(weight, weight > 0 ? truth[s.joints[k]] / kept : 0, 1e-4);
    }
    for (size_t j = 0; j < truth.size(); ++j) {
      const bool dropped = std::find(s.joints.begin(), s.joints.end(), j) == s.joints.end();
      EXPECT_LE(dropped ? truth[j] : 0, kept / 4 + 1e-6) << "a joint dropped for smaller ones";
    }
    return closest.signed_distance;
  };
  double squares = 0;
  size_t seen = 0;
  for (size_t i = 0; i < d.samples.surface.size() && !testing::Test::HasFailure(); i += stride)
    EXPECT_NEAR(expect_weights(d.samples.surface[i]), 0, float_metres) << i;
  for (size_t i = 0; i < d.samples.around.size() && !testing::Test::HasFailure(); i += stride, ++seen) {
    const double distance = expect_weights(d.samples.around[i]);
    squares += distance * distance;
  }
  // N(0, 3 cm) along each axis: as far along a flat surface's normal, somewhat less where the surface bends
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(seen)), 0.03, 0.007);
}

TEST(TemplateSamplesTest, TheSeedDecides) {
  const Drawn& d = drawn();
  const TemplateSamples again = draw_template_samples(d.avatar, 3), other = draw_template_samples(d.avatar, 4);
  const auto same = [](const std::vector<DistanceSample>& a, const std::vector<DistanceSample>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0;
  };
  EXPECT_TRUE(same(again.near, d.samples.near));
  EXPECT_TRUE(same(again.volume, d.samples.volume));
  EXPECT_EQ(again.off_surface, d.samples.off_surface);
  EXPECT_EQ(again.inside, d.samples.inside);
  EXPECT_FALSE(same(other.near, d.samples.near));
}

}  // namespace
}  // namespace arah
