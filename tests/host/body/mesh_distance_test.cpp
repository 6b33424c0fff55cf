#include "host/body/mesh_distance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <random>

namespace arah {
namespace {

// The box [−1, 2] × [−1, 1]²; its distance has a closed form.
const std::vector<glm::dvec3> vertices{{-1, -1, -1}, {2, -1, -1}, {2, 1, -1}, {-1, 1, -1}, {-1, -1, 1}, {2, -1, 1}, {2, 1, 1}, {-1, 1, 1}};
const std::vector<glm::uvec3> triangles{{0, 2, 1}, {0, 3, 2}, {4, 5, 6}, {4, 6, 7}, {0, 1, 5}, {0, 5, 4}, {3, 6, 2}, {3, 7, 6}, {0, 4, 7}, {0, 7, 3}, {1, 2, 6}, {1, 6, 5}};

double box_distance(const glm::dvec3& p) {
  const glm::dvec3 q = glm::abs(p - glm::dvec3(0.5, 0, 0)) - glm::dvec3(1.5, 1, 1);
  return glm::length(glm::max(q, glm::dvec3(0))) + std::min(std::max({q.x, q.y, q.z}), 0.0);
}

TEST(MeshDistance, AgreesWithTheBoxInsideAndOutside) {
  const MeshDistance mesh(vertices, triangles);
  std::mt19937_64 generator(3);
  std::uniform_real_distribution<double> uniform(-4, 4);
  double worst = 0;
  for (int i = 0; i < 3000; ++i) {
    const glm::dvec3 p(uniform(generator), uniform(generator), uniform(generator));
    const ClosestPoint closest = mesh.closest(p);
    worst = std::max(worst, std::abs(closest.signed_distance - box_distance(p)));
    const glm::uvec3 t = triangles[closest.triangle];
    const glm::dvec3 from_weights = closest.barycentric.x * vertices[t.x] + closest.barycentric.y * vertices[t.y] + closest.barycentric.z * vertices[t.z];
    ASSERT_LT(glm::distance(from_weights, closest.position), 1e-12);
    ASSERT_NEAR(glm::distance(p, closest.position), std::abs(closest.signed_distance), 1e-12);
  }
  EXPECT_LT(worst, 1e-6);
}

TEST(MeshDistance, TakesTrianglesWithoutAreaForTheirEdges) {
  std::vector<glm::dvec3> more = vertices;
  more.insert(more.end(), {{-1, -1, -1}, {-1 + 1e-17, -1, -1}, {5, 0, 0}, {5, 0, 0}});
  std::vector<glm::uvec3> flat = triangles;
  for (const glm::uvec3& t : {glm::uvec3(0, 8, 1), glm::uvec3(0, 9, 3), glm::uvec3(10, 10, 10), glm::uvec3(10, 11, 10), glm::uvec3(0, 0, 0)}) flat.push_back(t), flat.insert(flat.begin(), {t.y, t.z, t.x});
  const MeshDistance mesh(more, flat);
  std::mt19937_64 generator(4);
  std::uniform_real_distribution<double> uniform(-6, 6);
  for (int i = 0; i < 3000; ++i) {
    const glm::dvec3 p(uniform(generator), uniform(generator), uniform(generator));
    EXPECT_NEAR(std::abs(mesh.closest(p).signed_distance), std::min(std::abs(box_distance(p)), glm::distance(p, more[10])), 1e-6) << i;
  }
}

TEST(MeshDistance, RefusesAnEmptyMeshAndWrongIndices) {
  EXPECT_THROW(MeshDistance({}, {}), std::invalid_argument);
  const std::vector<glm::uvec3> wrong{{0, 1, 8}};
  EXPECT_THROW(MeshDistance(vertices, wrong), std::invalid_argument);
}

}  // namespace
}  // namespace arah
