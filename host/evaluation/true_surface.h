// The true surface that a synthetic capture keeps for a frame: meshes/<split>_<frame>.ply.
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <vector>

namespace arah {

struct TrueSurface {
  std::vector<glm::dvec3> vertices;  // metres
  std::vector<glm::uvec3> triangles;
  std::vector<bool> without_hair;  // [V] of a face that is not hair
};

// A binary little-endian PLY with "float x y z" of vertices and "list uchar int vertex_indices, uchar part" of faces, polygons
// cut into triangles. Throws InputError naming the file: another layout, fewer bytes than its counts need, indices out of range,
// places that are not finite, no face but hair. Takes memory in proportion to the file.
TrueSurface read_true_surface(const std::filesystem::path& path);

}  // namespace arah
