// Meshes and points as files that every modelling program reads.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

namespace arah {

// Metres. Normals of unit length; colours 0..1 as shown (sRGB), [V], or none. Points alone have no triangles.
struct ColoredMesh {
  std::vector<glm::vec3> vertices, normals, colors;
  std::vector<glm::uvec3> triangles;
};

// Binary little-endian: float x y z nx ny nz, uchar red green blue where there are colours; faces as "list uchar int
// vertex_indices" where there are triangles. `comment`: one line of the header. Throw std::invalid_argument where lists are not
// equally long.
std::vector<std::uint8_t> ply_file(const ColoredMesh& mesh, const std::string& comment);

// Text: "v x y z" with the colour behind it (read by MeshLab, Blender and others; it is no part of the format), "vn", "f a//a".
std::vector<std::uint8_t> obj_file(const ColoredMesh& mesh, const std::string& comment);

// So many points, evenly over the surface's area at random (counter-based: the same seed, the same points), with
// normals and colours between those of the vertices.
ColoredMesh sampled_points(const ColoredMesh& mesh, std::size_t count, std::uint64_t seed);

}  // namespace arah
