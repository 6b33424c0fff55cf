#include "kernels/reference/tracing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "tests/golden.h"
#include "tests/kernels/reference/matrix_rows.h"

namespace arah::reference {
namespace {

const Vector<3> kMinimum{-1, -2, -3}, kMaximum{1, 2, 3};

Matrix<4> rotation_z(double angle, const Vector<3>& translation) {
  Matrix<4> t = identity<4>();
  t[0][0] = t[1][1] = std::cos(angle);
  t[1][0] = std::sin(angle);
  t[0][1] = -std::sin(angle);
  for (int i = 0; i < 3; ++i) t[i][3] = translation[i];
  return t;
}

TEST(IntersectBox, DepthsAlongTheRay) {
  const RayInterval along_x = intersect_box({-5, 0.5, 0.5}, {1, 0, 0}, kMinimum, kMaximum);
  EXPECT_TRUE(along_x.hit);
  EXPECT_NEAR(along_x.near, 4, 1e-12);
  EXPECT_NEAR(along_x.far, 6, 1e-12);
  const double s = std::sqrt(0.5);
  const RayInterval slanted = intersect_box({-2, -2, 0}, {s, s, 0}, kMinimum, kMaximum);
  EXPECT_TRUE(slanted.hit);
  EXPECT_NEAR(slanted.near, std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(slanted.far, 3 * std::sqrt(2.0), 1e-12);
}

TEST(IntersectBox, MissesAndBehind) {
  EXPECT_FALSE(intersect_box({-5, 5, 0}, {1, 0, 0}, kMinimum, kMaximum).hit);
  EXPECT_FALSE(intersect_box({5, 0, 0}, {1, 0, 0}, kMinimum, kMaximum).hit);
  EXPECT_TRUE(intersect_box({5, 0, 0}, {-1, 0, 0}, kMinimum, kMaximum).hit);
}

TEST(IntersectBox, FromInsideStartsAtZero) {
  const RayInterval inside = intersect_box({0, 0, 0}, {0, 0, 1}, kMinimum, kMaximum);
  EXPECT_TRUE(inside.hit);
  EXPECT_EQ(inside.near, 0);
  EXPECT_NEAR(inside.far, 3, 1e-12);
}

TEST(IntersectBox, ParallelToAFace) {
  for (double tiny : {0.0, -0.0, 1e-9, -1e-9, 9.9e-6}) {
    EXPECT_TRUE(intersect_box({-5, 1.9, 0}, {1, tiny, 0}, kMinimum, kMaximum).hit) << tiny;
    EXPECT_FALSE(intersect_box({-5, 2.1, 0}, {1, tiny, 0}, kMinimum, kMaximum).hit) << tiny;
  }
  // In the face's plane itself: a zero component counts as +1e-12, so the ray leaves through the upper face at once and
  // enters through the lower one.
  EXPECT_FALSE(intersect_box({-5, 2, 0}, {1, 0, 0}, kMinimum, kMaximum).hit);
  EXPECT_TRUE(intersect_box({-5, -2, 0}, {1, 0, 0}, kMinimum, kMaximum).hit);
}

TEST(IntersectBox, DegenerateBoxesAndInputsNeverHit) {
  EXPECT_FALSE(intersect_box({-5, 0, 0}, {1, 0, 0}, {0, 0, 0}, {0, 0, 0}).hit);
  EXPECT_FALSE(intersect_box({-5, 0, 0}, {1, 0, 0}, {0, -1, -1}, {0, 1, 1}).hit);
  EXPECT_TRUE(intersect_box({-5, 0, 0}, {1, 0, 0}, {-1, -1e-9, -1}, {1, 1e-4, 1}).hit);
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(intersect_box({nan, 0, 0}, {1, 0, 0}, kMinimum, kMaximum).hit);
  EXPECT_FALSE(intersect_box({-5, 0, 0}, {1, nan, 0}, kMinimum, kMaximum).hit);
  EXPECT_FALSE(intersect_box({-5, 0, 0}, {1, 0, 0}, {-inf, -inf, -inf}, {inf, inf, inf}).hit);
}

TEST(IntersectBox, Golden07And12) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  for (const char* name : {"07_broyden_joint", "12_step"}) {
    const golden::Case truth(name);
    const auto directions = truth.values("in.dir"), box = truth.values("in.box");
    std::vector<double> near_far;
    for (std::size_t i = 0; i < directions.size() / 3; ++i) {
      const RayInterval interval =
          intersect_box(row<3>(truth.values("in.cam"), 0), row<3>(directions, i), row<3>(box, 0), row<3>(box, 1));
      EXPECT_TRUE(interval.hit);
      near_far.insert(near_far.end(), {interval.near, interval.far});
    }
    golden::expect_golden(truth, "in.near_far", near_far);
  }
}

TEST(NearestVertex, LowestIndexOfEquallyNearOnes) {
  const std::vector<Vector<3>> vertices{{9, 0, 0}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {1, 0, 0}};
  EXPECT_EQ(nearest_vertex({0, 0, 0}, vertices), 1u);
  EXPECT_EQ(nearest_vertex({-1e-9, 0, 0}, vertices), 2u);
  EXPECT_EQ(nearest_vertex({8, 0, 0}, vertices), 0u);
  EXPECT_EQ(nearest_vertex({std::numeric_limits<double>::quiet_NaN(), 0, 0}, vertices), 0u);
}

// A two-bone "body" of three vertices; the correspondence is the inverse of the nearest vertex' blend.
struct TwoBones {
  std::vector<Vector<3>> vertices{{0, 0, 0}, {2, 0, 0}, {4, 0, 0}};
  std::vector<double> weights{1, 0, 0.5, 0.5, 0, 1};
  std::vector<Matrix<4>> bones{rotation_z(0.3, {0.1, 0.2, 0.3}), rotation_z(-0.8, {1, -2, 3})};
  PosedTemplate posed() const { return {vertices, weights, bones}; }
};

TEST(TemplateCorrespondence, BlendsTheNearestVertexWeights) {
  const TwoBones body;
  const std::vector<Vector<3>> queries{{0.2, 0.1, 0}, {2.2, 0.4, -1}, {5, 1, 1}};
  for (std::size_t i = 0; i < queries.size(); ++i) {
    const Correspondence found = template_correspondence(queries[i], body.posed());
    EXPECT_EQ(found.vertex, i);
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c)
        EXPECT_NEAR(found.transform[r][c],
                    body.weights[2 * i] * body.bones[0][r][c] + body.weights[2 * i + 1] * body.bones[1][r][c], 1e-15);
    const Vector<3> back = transform_point(found.transform, found.canonical);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(back[c], queries[i][c], 1e-12);
  }
}

// Rays that reached the surface ended on an evaluated depth: the canonical point stored for it is that depth's.
TEST(TemplateCorrespondence, Golden12) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("12_step");
  const auto vertices = truth.values("in.verts"), bones = truth.values("in.B"), cam = truth.values("in.cam"),
             trans = truth.values("in.trans"), directions = truth.values("in.dir"),
             depths = truth.values("full.sphere_d0"), starts = truth.values("full.sphere_x0");
  const auto hit = truth.integers("in.samples.hit");
  std::vector<Vector<3>> posed_vertices;
  for (std::size_t i = 0; i < vertices.size() / 3; ++i) {
    posed_vertices.push_back(row<3>(vertices, i));
    for (int c = 0; c < 3; ++c) posed_vertices[i][c] -= trans[c];
  }
  std::vector<Matrix<4>> transforms;
  for (std::size_t b = 0; b < bones.size() / 16; ++b) transforms.push_back(matrix<4>(bones, b));
  const auto weights = truth.values("in.verts_w");
  std::vector<double> found, expected;
  for (std::size_t i = 0; i < depths.size(); ++i) {
    if (!hit[i]) continue;
    Vector<3> posed;
    for (int c = 0; c < 3; ++c) posed[c] = cam[c] + depths[i] * directions[3 * i + c] - trans[c];
    append<3>(found, template_correspondence(posed, {posed_vertices, weights, transforms}).canonical);
    append<3>(expected, row<3>(starts, i));
  }
  ASSERT_FALSE(found.empty());
  golden::expect_close("sphere tracing's canonical points", found, expected, 1e-10);
}

TEST(TemplateCorrespondence, OpposedRotationsHaveNoCanonicalPoint) {
  // Half of each of two rotations by ±90° about z cancels in the plane: the blend is singular.
  TwoBones body;
  body.bones = {rotation_z(std::numbers::pi / 2, {0, 0, 0}), rotation_z(-std::numbers::pi / 2, {0, 0, 0})};
  const Correspondence found = template_correspondence({2, 0, 0}, body.posed());
  EXPECT_TRUE(std::isnan(found.canonical[0]));
  const TracedRay ray = trace_sphere(
      {2, 0, -1}, {0, 0, 1}, 0.1, 3,
      [&](const Vector<3>& posed) { return template_correspondence(posed, body.posed()); },
      [](const Vector<3>& x) { return norm<3>(x) - 0.2; });
  EXPECT_TRUE(ray.diverged);
  EXPECT_FALSE(ray.on_surface);
  EXPECT_EQ(ray.evaluations, 1);
}

struct Sphere {
  Vector<3> center{0, 0, 0};
  double radius = 0.5;
  double operator()(const Vector<3>& x) const {
    return norm<3>({x[0] - center[0], x[1] - center[1], x[2] - center[2]}) - radius;
  }
};

Correspondence unposed(const Vector<3>& posed) {
  return {posed, identity<4>(), 0};
}

TEST(TraceSphere, FindsTheNearSide) {
  const TracedRay ray = trace_sphere({0, 0.3, -2}, {0, 0, 1}, 1, 3, unposed, Sphere{});
  EXPECT_TRUE(ray.on_surface);
  EXPECT_FALSE(ray.diverged);
  EXPECT_NEAR(ray.depth, 2 - 0.4, 3e-5);
  EXPECT_LE(std::abs(ray.sdf), 1e-5);
  EXPECT_NEAR(ray.canonical[2], -0.4, 3e-5);
}

TEST(TraceSphere, ThroughAPosedBone) {
  // The canonical sphere moves with the bone: a hit at the posed sphere's near side.
  const TwoBones body;
  const Vector<3> canonical_center{-0.1, -0.05, -0.3};
  const Vector<3> center = transform_point(body.bones[0], canonical_center);
  const TracedRay ray = trace_sphere(
      {center[0], center[1], center[2] - 1}, {0, 0, 1}, 0.2, 2,
      [&](const Vector<3>& posed) { return template_correspondence(posed, body.posed()); },
      Sphere{canonical_center, 0.25});
  EXPECT_TRUE(ray.on_surface);
  EXPECT_NEAR(ray.depth, 0.75, 2e-5);
}

TEST(TraceSphere, StepsAreLimitedBothWays) {
  // 10 cm steps: 0.8 m of free space need 8 of them. From inside, steps go back.
  EXPECT_EQ(trace_sphere({0, 0, -2}, {0, 0, 1}, 0.7, 3, unposed, Sphere{}).evaluations, 9);
  const TracedRay inside = trace_sphere({0, 0, -2}, {0, 0, 1}, 1.75, 3, unposed, Sphere{});
  EXPECT_TRUE(inside.on_surface);
  EXPECT_NEAR(inside.depth, 1.5, 2e-5);
}

TEST(TraceSphere, LeavesTheIntervalOrRunsOut) {
  const TracedRay missed = trace_sphere({0, 0.8, -2}, {0, 0, 1}, 1, 3, unposed, Sphere{});
  EXPECT_TRUE(missed.diverged);
  EXPECT_GE(missed.depth, 3);
  const TracedRay slow = trace_sphere({0, 0.8, -20}, {0, 0, 1}, 1, 30, unposed, Sphere{});
  EXPECT_EQ(slow.evaluations, 50);
  EXPECT_FALSE(slow.on_surface || slow.diverged);
  const TracedRay lost = trace_sphere({0, 0, -2}, {0, 0, 1}, 1, 3, unposed,
                                      [](const Vector<3>&) { return std::numeric_limits<double>::quiet_NaN(); });
  EXPECT_TRUE(lost.diverged);
  EXPECT_EQ(lost.evaluations, 1);
}

}  // namespace
}  // namespace arah::reference
