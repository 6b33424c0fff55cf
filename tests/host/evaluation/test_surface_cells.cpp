// Cubes around zero sets from coarse to fine, and their meshes by the device.
#include "host/evaluation/surface_cells.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <map>

#include "host/evaluation/marched_mesh.h"

namespace arah {
namespace {

FieldSamples<float> sampled(const ImplicitField& field, const glm::dvec3& low, double cell, const glm::ivec3& nodes) {
  FieldSamples<float> samples{low, cell, nodes, {}};
  for (int z = 0; z < nodes.z; ++z)
    for (int y = 0; y < nodes.y; ++y)
      for (int x = 0; x < nodes.x; ++x) samples.values.push_back(static_cast<float>(field(samples.position(x, y, z))));
  return samples;
}

DistancesAt asking(const ImplicitField& field) {
  return [field](std::span<const glm::dvec3> points) {
    std::vector<double> values;
    for (const glm::dvec3& p : points) values.push_back(field(p));
    return values;
  };
}

TriangleMesh meshed(const SurfaceCells& cells) {
  Device device;
  Commands commands(device);
  return marched_mesh(device, commands, cells);
}

size_t open_edges(const TriangleMesh& mesh) {
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (const glm::uvec3& t : mesh.triangles)
    for (int k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  size_t open = 0;
  for (const auto& [edge, times] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    open += back == edges.end() || back->second != times;
  }
  return open;
}

double volume(const TriangleMesh& mesh) {
  double sum = 0;
  for (const glm::uvec3& t : mesh.triangles) sum += glm::dot(mesh.vertices[t.x], glm::cross(mesh.vertices[t.y], mesh.vertices[t.z])) / 6;
  return sum;
}

const ImplicitField ball = [](const glm::dvec3& p) { return glm::length(p) - 0.1; };
const double ball_volume = 4.0 / 3 * 3.14159265358979 * 0.001;

TEST(SurfaceCells, AskForWhatIsNearAlone) {
  const FieldSamples<float> rough = sampled(ball, glm::dvec3(-0.16), 0.008, glm::ivec3(41));
  double before = 0;
  for (const int halvings : {0, 1, 2}) {
    const SurfaceCells cells = surface_cells(rough, halvings, 0, asking(ball));
    EXPECT_DOUBLE_EQ(cells.cell, 0.008 / (1 << halvings));
    const TriangleMesh mesh = meshed(cells);
    EXPECT_EQ(open_edges(mesh), 0u);
    const double missing = 1 - volume(mesh) / ball_volume, all = std::pow(40.0 * (1 << halvings) + 1, 3);
    std::printf("  %g mm: %llu points asked (%.2g of the box), %zu triangles, volume short by %.1e\n", 1000 * cells.cell, static_cast<unsigned long long>(cells.evaluated), double(cells.evaluated) / all, mesh.triangles.size(), missing);
    EXPECT_LT(std::abs(missing), 0.64 * cells.cell * cells.cell / 0.01);  // as in the kernel's own test
    EXPECT_LT(double(cells.evaluated), (halvings == 2 ? 0.08 : 0.12) * all);
    EXPECT_EQ(cells.evaluated == 0, halvings == 0);
    if (halvings > 1) {
      EXPECT_GT(before / missing, 3) << "of second order";
    }
    before = missing;
    double farthest = 0;
    for (const glm::dvec3& v : mesh.vertices) farthest = std::max(farthest, std::abs(ball(v)));
    EXPECT_LT(farthest, cells.cell * cells.cell / 8 / 0.1 * 1.1 + cells.cell / 1024);
  }
}

TEST(SurfaceCells, LieAtTheLevel) {
  const FieldSamples<float> rough = sampled(ball, glm::dvec3(-0.16), 0.008, glm::ivec3(41));
  for (const glm::dvec3& v : meshed(surface_cells(rough, 1, 0.012, asking(ball))).vertices) EXPECT_NEAR(glm::length(v), 0.112, 2e-5);
}

// The rough field knows nothing of a bump that the true one has: found from where it begins.
TEST(SurfaceCells, FollowTheSurfaceBeyondTheFirstGuess) {
  const ImplicitField bumped = [](const glm::dvec3& p) { return std::min(ball(p), glm::length(p - glm::dvec3(0.1, 0, 0)) - 0.02); };
  const FieldSamples<float> rough = sampled(ball, glm::dvec3(-0.16), 0.008, glm::ivec3(41));
  const TriangleMesh mesh = meshed(surface_cells(rough, 2, 0, asking(bumped)));
  EXPECT_EQ(open_edges(mesh), 0u);
  double farthest = 0;
  for (const glm::dvec3& v : mesh.vertices) farthest = std::max(farthest, v.x);
  EXPECT_NEAR(farthest, 0.116, 0.0045) << "as far as the rough field leaves it open: two of its cells";
}

// A field that is steeper than a distance, as a trained network's is in places: no hole where its values are far from 0 at all corners of a cube.
TEST(SurfaceCells, MissNothingOfASteepField) {
  for (const double slope : {0.5, 1.0, 1.3, 2.0, 4.0, 10.0}) {
    const ImplicitField steep = [slope](const glm::dvec3& p) { return slope * ball(p); };
    const TriangleMesh mesh = meshed(surface_cells(sampled(steep, glm::dvec3(-0.16), 0.016, glm::ivec3(21)), 2, 0, asking(steep)));
    EXPECT_EQ(open_edges(mesh), 0u) << "slope " << slope;
    EXPECT_NEAR(volume(mesh) / ball_volume, 1, 3e-3) << "slope " << slope;
  }
}

TEST(SurfaceCells, CloseTheMeshAtTheBoxAndRefuseNotANumber) {
  const FieldSamples<float> rough = sampled(ball, glm::dvec3(-0.16, -0.16, -0.16), 0.008, glm::ivec3(21, 41, 41));  // cut through the middle
  const TriangleMesh half = meshed(surface_cells(rough, 1, 0, asking(ball)));
  EXPECT_EQ(open_edges(half), 0u);
  EXPECT_NEAR(volume(half) / ball_volume, 0.5, 0.04);
  const ImplicitField broken = [](const glm::dvec3& p) { return p.x > 0.05 ? std::numeric_limits<double>::quiet_NaN() : ball(p); };
  EXPECT_THROW(surface_cells(rough, 1, 0, asking([](const glm::dvec3&) { return std::numeric_limits<double>::infinity(); })), std::runtime_error);
  EXPECT_THROW(surface_cells(sampled(ball, glm::dvec3(-0.16), 0.008, glm::ivec3(41)), 1, 0, asking(broken)), std::runtime_error);
  EXPECT_TRUE(meshed(surface_cells(sampled([](const glm::dvec3&) { return 1.0; }, glm::dvec3(0), 0.1, glm::ivec3(4)), 2, 0, asking(ball))).triangles.empty());
}

TEST(SmallParts, AreLeftOut) {
  const ImplicitField two = [](const glm::dvec3& p) { return std::min(ball(p), glm::length(p - glm::dvec3(0.14, 0, 0)) - 0.012); };
  const TriangleMesh both = mesh_zero_set(two, glm::dvec3(-0.2), glm::dvec3(0.2), 0.004);
  const auto reaches = [](const TriangleMesh& mesh) {
    double farthest = 0;
    for (const glm::dvec3& v : mesh.vertices) farthest = std::max(farthest, v.x);
    return farthest;
  };
  EXPECT_GT(reaches(without_small_parts(both, 0.01)), 0.15);
  EXPECT_LT(reaches(without_small_parts(both, 0.05)), 0.11);
  EXPECT_LT(reaches(without_small_parts(both, 1)), 0.11);
  EXPECT_EQ(without_small_parts(both, 0).vertices.size(), both.vertices.size());
}

}  // namespace
}  // namespace arah
