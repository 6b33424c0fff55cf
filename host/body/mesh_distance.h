// Distance to a closed triangle mesh, with sign, and the closest point on it (through Embree).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <glm/vec3.hpp>

namespace arah {

struct ClosestPoint {
  double signed_distance = 0;  // metres (the mesh's unit), negative inside
  glm::dvec3 position{0.0};
  uint32_t triangle = 0;
  glm::dvec3 barycentric{0.0};  // of the triangle's three vertices, ≥ 0, sum 1
};

// Copies the mesh. Queries may run from several threads at a time.
class MeshDistance {
 public:
  // Throws std::invalid_argument for an empty mesh or indices out of range, std::runtime_error where Embree does not start.
  MeshDistance(std::span<const glm::dvec3> vertices, std::span<const glm::uvec3> triangles);
  ~MeshDistance();
  MeshDistance(const MeshDistance&) = delete;
  MeshDistance& operator=(const MeshDistance&) = delete;

  // The sign is the majority of three rays' answers to "is the first surface met from behind?"; a mesh with small holes
  // still gives the right sign away from them.
  ClosestPoint closest(const glm::dvec3& point) const;

 private:
  struct Scene;
  std::unique_ptr<Scene> scene_;
};

}  // namespace arah
