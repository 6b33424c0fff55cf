// Distances between meshes: against the golden figures and against spheres, whose figures are known by hand.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "host/capture/implicit_surface.h"
#include "host/evaluation/mesh_metrics.h"
#include "tests/golden.h"

namespace arah {
namespace {

struct Mesh {
  std::vector<glm::dvec3> vertices;
  std::vector<glm::uvec3> triangles;
  operator MeshView() const { return {vertices, triangles}; }
};

Mesh golden_mesh(const golden::Case& truth, const std::string& name) {
  const std::vector<double> v = truth.values("in." + name + ".v");
  const std::vector<int32_t> f = truth.integers("in." + name + ".f");
  Mesh mesh;
  for (size_t i = 0; i < v.size(); i += 3) mesh.vertices.emplace_back(v[i], v[i + 1], v[i + 2]);
  for (size_t i = 0; i < f.size(); i += 3) mesh.triangles.emplace_back(f[i], f[i + 1], f[i + 2]);
  return mesh;
}

std::vector<double> flat(const std::vector<glm::dvec3>& vectors) {
  std::vector<double> numbers;
  for (const glm::dvec3& v : vectors) numbers.insert(numbers.end(), {v.x, v.y, v.z});
  return numbers;
}

// A closed ball of latitudes and longitudes, rings from the top.
Mesh sphere(double radius, bool outward = true) {
  constexpr uint32_t rings = 48, around = 96;
  Mesh mesh;
  mesh.vertices.emplace_back(0, radius, 0);
  for (uint32_t i = 1; i < rings; ++i)
    for (uint32_t j = 0; j < around; ++j) {
      const double polar = std::numbers::pi * i / rings, azimuth = 2 * std::numbers::pi * j / around;
      mesh.vertices.push_back(radius * glm::dvec3(std::sin(polar) * std::cos(azimuth), std::cos(polar), std::sin(polar) * std::sin(azimuth)));
    }
  mesh.vertices.emplace_back(0, -radius, 0);
  const auto at = [&](uint32_t i, uint32_t j) { return i == 0 ? 0 : i == rings ? 1 + (rings - 1) * around : 1 + (i - 1) * around + j % around; };
  for (uint32_t i = 0; i < rings; ++i)
    for (uint32_t j = 0; j < around; ++j) {
      const uint32_t a = at(i, j), b = at(i, j + 1), c = at(i + 1, j), d = at(i + 1, j + 1);
      for (const glm::uvec3& t : {glm::uvec3(a, b, c), glm::uvec3(b, d, c)})
        if (t.x != t.y && t.y != t.z) mesh.triangles.push_back(outward ? t : glm::uvec3(t.x, t.z, t.y));
    }
  return mesh;
}

TEST(MeshMetrics, MatchTheGoldenFigures) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("13_metrics_meshes");
  const Mesh a = golden_mesh(truth, "A"), b = golden_mesh(truth, "B");
  golden::expect_golden(truth, "out.A.normals", flat(vertex_normals(a.vertices, a.triangles)));
  golden::expect_golden(truth, "out.B.normals", flat(vertex_normals(b.vertices, b.triangles)));
  const MeshMetrics metrics = mesh_metrics(a, b);
  const auto &to = metrics.to_truth, &from = metrics.to_prediction;
  golden::expect_golden(truth, "out.chamfer_A2B", 1e4 * to.vertex_squared);
  golden::expect_golden(truth, "out.chamfer_B2A", 1e4 * from.vertex_squared);
  golden::expect_golden(truth, "out.chamfer_mean", 1e4 * metrics.chamfer());
  golden::expect_golden(truth, "out.chamfer_sum", 2e4 * metrics.chamfer());
  golden::expect_golden(truth, "out.l1_A2B", 100 * to.vertex_mean);
  golden::expect_golden(truth, "out.l1_B2A", 100 * from.vertex_mean);
  golden::expect_golden(truth, "out.nc_dot_A2B", to.normals);
  golden::expect_golden(truth, "out.nc_dot_B2A", from.normals);
  golden::expect_golden(truth, "out.nc_dot", metrics.normal_consistency());
  golden::expect_golden(truth, "out.nc_absdot", metrics.normal_consistency_unsigned());
  golden::expect_golden(truth, "out.nc_author", metrics.normal_consistency_of_the_paper());
  golden::expect_golden(truth, "out.p2s_A2B_all", to.to_surface);
  golden::expect_golden(truth, "out.p2s_A2B", 100 * to.surface_mean);
  golden::expect_golden(truth, "out.p2s_A2B_sq", 1e4 * to.surface_squared);
  golden::expect_golden(truth, "out.p2s_A2B_max", 100 * to.surface_max);
  golden::expect_golden(truth, "out.p2s_B2A", 100 * from.surface_mean);
  golden::expect_golden(truth, "out.p2s_B2A_sq", 1e4 * from.surface_squared);
  golden::expect_golden(truth, "out.p2s_B2A_max", 100 * from.surface_max);
}

TEST(MeshMetrics, OfAMeshWithItselfArePerfect) {
  const MeshMetrics metrics = mesh_metrics(sphere(0.3), sphere(0.3));
  EXPECT_EQ(metrics.chamfer(), 0);
  EXPECT_NEAR(metrics.to_truth.surface_max, 0, 1e-9);
  EXPECT_NEAR(metrics.normal_consistency(), 1, 1e-12);
  EXPECT_NEAR(metrics.normal_consistency_of_the_paper(), 1, 1e-7);
  EXPECT_EQ(metrics.f_score(1e-6), 1);
}

TEST(MeshMetrics, OfConcentricSpheresAreTheDifferenceOfTheirRadii) {
  const MeshMetrics metrics = mesh_metrics(sphere(0.31), sphere(0.30));  // vertices on common radii
  EXPECT_NEAR(metrics.chamfer(), 1e-4, 1e-12);
  EXPECT_NEAR(metrics.to_truth.vertex_mean, 0.01, 1e-12);
  EXPECT_NEAR(metrics.to_truth.surface_mean, 0.01, 2e-4);  // chords lie inside the sphere
  EXPECT_NEAR(metrics.normal_consistency(), 1, 1e-12);
  EXPECT_EQ(metrics.f_score(0.0110), 1);
  EXPECT_EQ(metrics.f_score(0.0090), 0);
}

TEST(MeshMetrics, TellMissingPartsFromAddedOnes) {
  Mesh truth = sphere(0.3), half = truth;
  std::erase_if(half.triangles, [&](const glm::uvec3& t) { return half.vertices[t.x].y < 0 || half.vertices[t.y].y < 0 || half.vertices[t.z].y < 0; });
  const auto first_below = std::find_if(half.vertices.begin(), half.vertices.end(), [](const glm::dvec3& v) { return v.y < -1e-9; });
  half.vertices.erase(first_below, half.vertices.end());  // rings come from the top
  const MeshMetrics metrics = mesh_metrics(half, truth);
  EXPECT_LT(metrics.to_truth.surface_max, 1e-6);        // all that is there is right
  EXPECT_GT(metrics.to_prediction.surface_max, 0.29);   // the lower pole is far from it
  const double recall = metrics.to_prediction.share_within(0.001);
  EXPECT_NEAR(metrics.f_score(0.001), 2 * recall / (1 + recall), 1e-12);
}

TEST(MeshMetrics, TurnedFacesCountAgainstTheConsistencyOnlyWithSign) {
  const MeshMetrics metrics = mesh_metrics(sphere(0.3, false), sphere(0.3));
  EXPECT_NEAR(metrics.normal_consistency(), -1, 1e-12);
  EXPECT_NEAR(metrics.normal_consistency_unsigned(), 1, 1e-12);
  EXPECT_NEAR(metrics.normal_consistency_of_the_paper(), -1, 1e-12);  // |n - n'| = 2 everywhere
}

TEST(MeshMetrics, RefuseWhatIsNoMesh) {
  const Mesh whole = sphere(0.3);
  Mesh broken = whole;
  broken.triangles.emplace_back(0, 1, broken.vertices.size());
  EXPECT_THROW(mesh_metrics(broken, whole), std::invalid_argument);
  EXPECT_THROW(mesh_metrics(whole, broken), std::invalid_argument);
  EXPECT_THROW(mesh_metrics(Mesh{}, whole), std::invalid_argument);
  EXPECT_THROW(mesh_metrics(whole, Mesh{whole.vertices, {}}), std::invalid_argument);
}

}  // namespace
}  // namespace arah
