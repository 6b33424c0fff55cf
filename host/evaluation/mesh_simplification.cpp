#include "host/evaluation/mesh_simplification.h"

#include <meshoptimizer.h>

#include <cstdint>
#include <limits>

namespace arah {

SimplifiedMesh simplified(const TriangleMesh& mesh, std::size_t most_triangles) {
  if (mesh.triangles.size() <= most_triangles) return {mesh, 0};
  std::vector<glm::vec3> places;
  for (const glm::dvec3& v : mesh.vertices) places.emplace_back(v);
  std::vector<unsigned int> corners, kept(3 * mesh.triangles.size());
  for (const glm::uvec3& t : mesh.triangles) corners.insert(corners.end(), {t.x, t.y, t.z});
  float relative = 0;
  kept.resize(meshopt_simplify(kept.data(), corners.data(), corners.size(), &places[0].x, places.size(), sizeof(glm::vec3), 3 * most_triangles, std::numeric_limits<float>::max(), 0, &relative));

  constexpr std::uint32_t unused = ~0u;
  std::vector<std::uint32_t> numbers(mesh.vertices.size(), unused);
  SimplifiedMesh result;
  result.error = double{relative} * double{meshopt_simplifyScale(&places[0].x, places.size(), sizeof(glm::vec3))};
  for (std::size_t i = 0; i < kept.size(); i += 3) {
    glm::uvec3 triangle;
    for (int k = 0; k < 3; ++k) {
      const unsigned int v = kept[i + static_cast<std::size_t>(k)];
      if (numbers[v] == unused) {
        numbers[v] = static_cast<std::uint32_t>(result.mesh.vertices.size());
        result.mesh.vertices.push_back(mesh.vertices[v]);
      }
      triangle[k] = numbers[v];
    }
    result.mesh.triangles.push_back(triangle);
  }
  return result;
}

}  // namespace arah
