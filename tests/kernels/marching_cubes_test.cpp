// Marching cubes on the device against the double-precision truth: the same triangles, the same places.
#include "kernels/meshing/marching_cubes.h"

#include <cmath>

#include "tests/kernels/device_fixture.h"
#include "tests/kernels/marching_scene.h"

namespace arah {
namespace {

class MarchingCubes : public DeviceTest {
 protected:
  // The mesh of a scene as the device makes it: vertices as x y z 1, triangles as three indices.
  std::pair<std::vector<float>, std::vector<uint32_t>> marched(const reference::MarchingScene& scene) {
    std::vector<float> values;
    for (const reference::CellNode& node : scene.nodes) {
      for (const double x : node.position) values.push_back(static_cast<float>(x));
      values.push_back(static_cast<float>(node.value));
    }
    const auto count = static_cast<uint32_t>(scene.corners.size());
    Buffer nodes = filled("nodes", values), corners = filled("corners", scene.corners), owners = filled("cells of nodes", scene.cell_of_node()), cases = filled("cases", marching_case_words());
    Buffer marks = empty("marks", count * 4ull), blocks = empty("blocks", marching_blocks(count) * 8ull), places = empty("places", count * 8ull), total = empty("total", 8);
    const MarchingCells cells{count, static_cast<uint32_t>(scene.nodes.size()), nodes.slice(), corners.slice(), owners.slice(), cases.slice(), marks.slice(), blocks.slice(), places.slice(), total.slice()};
    record_count_marched(commands, cells);
    commands.submit_and_wait();
    const MeshCount counted = device.download<MeshCount>(total.slice())[0];
    Buffer vertices = empty("vertices", std::max(1u, counted.vertices) * 16ull), triangles = empty("triangles", std::max(1u, counted.triangles) * 12ull);
    record_march(commands, cells, counted, vertices.slice(), triangles.slice());
    commands.submit_and_wait();
    std::vector<float> at = device.download<float>(vertices.slice());
    std::vector<uint32_t> joined = device.download<uint32_t>(triangles.slice());
    at.resize(counted.vertices * 4ull);
    joined.resize(counted.triangles * 3ull);
    return {at, joined};
  }

  void expect_the_reference(const reference::MarchingScene& scene, double tolerance) {
    const reference::MarchedSurface truth = reference::marching_cubes(scene.nodes, scene.corners);
    const auto [vertices, triangles] = marched(scene);
    ASSERT_EQ(vertices.size(), 4 * truth.vertices.size());
    ASSERT_EQ(triangles.size(), 3 * truth.triangles.size());
    double largest = 0;
    for (size_t v = 0; v < truth.vertices.size(); ++v)
      for (size_t k = 0; k < 3; ++k) largest = std::max(largest, std::abs(double{vertices[4 * v + k]} - truth.vertices[v][k]));
    std::printf("  %zu cells, %zu vertices, %zu triangles: largest error %.1e\n", scene.corners.size(), truth.vertices.size(), truth.triangles.size(), largest);
    EXPECT_LE(largest, tolerance);
    size_t different = 0;
    for (size_t t = 0; t < truth.triangles.size(); ++t)
      for (size_t k = 0; k < 3; ++k) different += triangles[3 * t + k] != truth.triangles[t][k];
    EXPECT_EQ(different, 0u);
  }
};

TEST_F(MarchingCubes, FollowTheReference) {
  // Values that a float holds exactly, so that both see the same sides; a place in an edge of h has an error of some 1e-7 h, its node one
  // of 6e-8 of its coordinate.
  for (const double share : {0.02, 0.5}) {
    reference::MarchingScene noise({40, 30, 37}, 0.125, [&](const std::array<double, 3>&) {
      const std::vector<float> random = uniform(2, 0, 1);
      return random[0] < share ? -double{random[1]} - 0.01 : double{random[1]} + 0.01;
    });
    noise.close();
    for (reference::CellNode& node : noise.nodes) node.value = double{static_cast<float>(node.value)};
    expect_the_reference(noise, 1e-6);
  }
  reference::MarchingScene sphere({65, 65, 65}, 1.0 / 64, [](const std::array<double, 3>& p) { return double{static_cast<float>(std::hypot(p[0] - 0.5, p[1] - 0.5, p[2] - 0.5) - 0.4)}; });
  expect_the_reference(sphere, 2e-7);
}

TEST_F(MarchingCubes, NeedOneCubeAtLeastAndMayFindNothing) {
  reference::MarchingScene nothing({3, 3, 3}, 1, [](const std::array<double, 3>& p) { return p[0] + 1; });
  EXPECT_TRUE(nothing.corners.empty());
  EXPECT_THROW(record_count_marched(commands, {}), std::invalid_argument);
  nothing.corners.push_back({0, 1, 3, 4, 9, 10, 12, 13});
  const auto [vertices, triangles] = marched(nothing);
  EXPECT_TRUE(vertices.empty());
  EXPECT_TRUE(triangles.empty());
}

TEST_F(MarchingCubes, SayWhereACubeIsMissing) {
  reference::MarchingScene sphere({9, 9, 9}, 0.125, [](const std::array<double, 3>& p) { return std::hypot(p[0] - 0.5, p[1] - 0.5, p[2] - 0.5) - 0.3; });
  sphere.make_a_hole();
  const auto [vertices, triangles] = marched(sphere);
  EXPECT_NE(std::find(triangles.begin(), triangles.end(), no_cell), triangles.end());
}

}  // namespace
}  // namespace arah
