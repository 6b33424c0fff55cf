#include "host/evaluation/mesh_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <iterator>
#include <stdexcept>

#include "kernels/reference/random.h"

namespace arah {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie in memory");

void check_lists(const ColoredMesh& mesh) {
  if (mesh.normals.size() != mesh.vertices.size() || (!mesh.colors.empty() && mesh.colors.size() != mesh.vertices.size()))
    throw std::invalid_argument(fmt::format("a mesh of {} vertices with {} normals and {} colours", mesh.vertices.size(), mesh.normals.size(), mesh.colors.size()));
}

template <typename Value>
void put(std::vector<std::uint8_t>& bytes, const Value& value) {
  const std::size_t at = bytes.size();
  bytes.resize(at + sizeof value);
  std::memcpy(&bytes[at], &value, sizeof value);
}

std::uint8_t byte_of(float value) { return static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f))); }

}  // namespace

std::vector<std::uint8_t> ply_file(const ColoredMesh& mesh, const std::string& comment) {
  check_lists(mesh);
  std::string header = fmt::format("ply\nformat binary_little_endian 1.0\ncomment {}\nelement vertex {}\n", comment, mesh.vertices.size());
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) header += fmt::format("property float {}\n", name);
  if (!mesh.colors.empty())
    for (const char* name : {"red", "green", "blue"}) header += fmt::format("property uchar {}\n", name);
  if (!mesh.triangles.empty()) header += fmt::format("element face {}\nproperty list uchar int vertex_indices\n", mesh.triangles.size());
  header += "end_header\n";
  std::vector<std::uint8_t> bytes(header.begin(), header.end());
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    for (const glm::vec3* vector : {&mesh.vertices[v], &mesh.normals[v]})
      for (int k = 0; k < 3; ++k) put(bytes, (*vector)[k]);
    if (!mesh.colors.empty())
      for (int k = 0; k < 3; ++k) put(bytes, byte_of(mesh.colors[v][k]));
  }
  for (const glm::uvec3& t : mesh.triangles) {
    put(bytes, std::uint8_t{3});
    for (int k = 0; k < 3; ++k) put(bytes, static_cast<std::int32_t>(t[k]));
  }
  return bytes;
}

std::vector<std::uint8_t> obj_file(const ColoredMesh& mesh, const std::string& comment) {
  check_lists(mesh);
  std::string text = fmt::format("# {}\n", comment);
  const auto to = std::back_inserter(text);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const glm::vec3& p = mesh.vertices[v];
    fmt::format_to(to, "v {} {} {}", p.x, p.y, p.z);  // the shortest that reads back exactly
    if (!mesh.colors.empty()) fmt::format_to(to, " {:.4f} {:.4f} {:.4f}", mesh.colors[v].x, mesh.colors[v].y, mesh.colors[v].z);
    text += '\n';
  }
  for (const glm::vec3& n : mesh.normals) fmt::format_to(to, "vn {:.5f} {:.5f} {:.5f}\n", n.x, n.y, n.z);
  for (const glm::uvec3& t : mesh.triangles) fmt::format_to(to, "f {0}//{0} {1}//{1} {2}//{2}\n", t.x + 1, t.y + 1, t.z + 1);
  return {text.begin(), text.end()};
}

ColoredMesh sampled_points(const ColoredMesh& mesh, std::size_t count, std::uint64_t seed) {
  check_lists(mesh);
  std::vector<double> area_up_to;
  double area = 0;
  for (const glm::uvec3& t : mesh.triangles) {
    const glm::dvec3 a(mesh.vertices[t.x]);
    area += glm::length(glm::cross(glm::dvec3(mesh.vertices[t.y]) - a, glm::dvec3(mesh.vertices[t.z]) - a)) / 2;
    area_up_to.push_back(area);
  }
  if (!(area > 0)) throw std::invalid_argument("points of a surface without area");
  ColoredMesh points;
  for (std::size_t i = 0; i < count; ++i) {
    const auto bits = reference::random_bits({static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32), static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(i >> 32)});
    const double which = area * (bits[0] + bits[3] * 0x1p-32) * 0x1p-32, u = bits[1] * 0x1p-32, v = bits[2] * 0x1p-32;
    const auto t = static_cast<std::size_t>(std::min<std::ptrdiff_t>(std::upper_bound(area_up_to.begin(), area_up_to.end(), which) - area_up_to.begin(), static_cast<std::ptrdiff_t>(area_up_to.size()) - 1));
    // Evenly over a triangle: (1 − √u, √u (1 − v), √u v).
    const double root = std::sqrt(u);
    const glm::vec3 part(1 - root, root * (1 - v), root * v);
    const auto between = [&](const std::vector<glm::vec3>& of) {
      const glm::uvec3& c = mesh.triangles[t];
      return part.x * of[c.x] + part.y * of[c.y] + part.z * of[c.z];
    };
    points.vertices.push_back(between(mesh.vertices));
    const glm::vec3 normal = between(mesh.normals);
    const float length = glm::length(normal);
    points.normals.push_back(length > 0 ? normal / length : mesh.normals[mesh.triangles[t].x]);
    if (!mesh.colors.empty()) points.colors.push_back(between(mesh.colors));
  }
  return points;
}

}  // namespace arah
