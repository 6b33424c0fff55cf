#include "host/evaluation/mesh_simplification.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <map>

namespace arah {
namespace {

TEST(Simplified, KeepsAClosedSurfaceNearItself) {
  const ImplicitField pill = [](const glm::dvec3& p) { return glm::length(p - glm::dvec3(glm::clamp(p.x, -0.1, 0.1), 0, 0)) - 0.05; };
  const TriangleMesh fine = mesh_zero_set(pill, glm::dvec3(-0.2, -0.1, -0.1), glm::dvec3(0.2, 0.1, 0.1), 0.004);
  ASSERT_GT(fine.triangles.size(), 10000u);
  for (const size_t most : {5000u, 1000u}) {
    const SimplifiedMesh coarse = simplified(fine, most);
    EXPECT_LE(coarse.mesh.triangles.size(), most);
    EXPECT_GT(coarse.mesh.triangles.size(), most - 10);
    EXPECT_EQ(2 * coarse.mesh.vertices.size(), coarse.mesh.triangles.size() + 4) << "a closed surface without holes through it";
    std::map<std::pair<uint32_t, uint32_t>, int> edges;
    double farthest = 0;
    for (const glm::uvec3& t : coarse.mesh.triangles) {
      for (int k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
      farthest = std::max(farthest, std::abs(pill((coarse.mesh.vertices[t.x] + coarse.mesh.vertices[t.y] + coarse.mesh.vertices[t.z]) / 3.0)));
    }
    size_t open = 0;
    for (const auto& [edge, times] : edges) open += times != 1 || !edges.contains({edge.second, edge.first});
    EXPECT_EQ(open, 0u);
    std::printf("  %zu of %zu triangles: said %.2f mm, middles of triangles off by %.2f mm at most\n", coarse.mesh.triangles.size(), fine.triangles.size(), 1000 * coarse.error, 1000 * farthest);
    EXPECT_GT(coarse.error, 0);
    EXPECT_LT(farthest, most == 5000 ? 0.0005 : 0.002);
  }
  EXPECT_EQ(simplified(fine, fine.triangles.size()).error, 0);
  EXPECT_EQ(simplified(fine, fine.triangles.size()).mesh.triangles.size(), fine.triangles.size());
}

}  // namespace
}  // namespace arah
