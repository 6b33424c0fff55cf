// Texture atlases and mesh files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <glm/geometric.hpp>
#include <map>
#include <sstream>

#include "host/evaluation/mesh_files.h"
#include "host/evaluation/texture_atlas.h"
#include "host/input_error.h"

namespace arah {
namespace {

// Two rings through one another: much of it hides behind itself from every side.
TriangleMesh two_rings() {
  const auto ring = [](const glm::dvec3& p, int axis) {
    const double around = glm::length(glm::dvec2(p[(axis + 1) % 3], p[(axis + 2) % 3])) - 0.3;
    return std::hypot(around, p[axis]) - 0.08;
  };
  return mesh_zero_set([&](const glm::dvec3& p) { return std::min(ring(p, 2), ring(p - glm::dvec3(0.3, 0, 0), 1)); }, {-0.6, -0.6, -0.6}, {0.9, 0.6, 0.6}, 0.02);
}

double double_area(const glm::dvec2& a, const glm::dvec2& b, const glm::dvec2& c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); }

TEST(TextureAtlasTest, ChartsHoldEveryTriangleAndDoNotOverlap) {
  const TriangleMesh mesh = two_rings();
  constexpr int size = 256;
  const TextureAtlas atlas = make_texture_atlas(mesh, size);
  ASSERT_EQ(atlas.triangles.size(), mesh.triangles.size());
  std::map<uint32_t, std::vector<uint32_t>> centres;  // by pixel: triangles whose inside its centre is in
  double flat = 0, shrunk = 10;
  for (uint32_t t = 0; t < atlas.triangles.size(); ++t) {
    std::array<glm::dvec2, 3> p;
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(atlas.vertices[atlas.triangles[t][k]], mesh.triangles[t][k]) << "another vertex than the mesh's";
      const glm::vec2 uv = atlas.uvs[atlas.triangles[t][k]];
      ASSERT_TRUE(uv.x >= 0 && uv.y >= 0 && uv.x <= 1 && uv.y <= 1);
      p[static_cast<size_t>(k)] = glm::dvec2(uv) * double(size);
    }
    const double area = double_area(p[0], p[1], p[2]) / 2;
    EXPECT_GT(area, 0) << "turned over";
    flat += area;
    const glm::uvec3& m = mesh.triangles[t];
    const double in_space = glm::length(glm::cross(mesh.vertices[m.y] - mesh.vertices[m.x], mesh.vertices[m.z] - mesh.vertices[m.x])) / 2;
    shrunk = std::min(shrunk, area / in_space / (atlas.texels_per_metre * atlas.texels_per_metre));
    for (int y = 0; y < size; ++y) {
      if (y + 0.5 < std::min({p[0].y, p[1].y, p[2].y}) || y + 0.5 > std::max({p[0].y, p[1].y, p[2].y})) continue;
      for (int x = 0; x < size; ++x) {
        const glm::dvec2 q(x + 0.5, y + 0.5);
        if (double_area(p[0], p[1], q) > 1e-6 && double_area(p[1], p[2], q) > 1e-6 && double_area(p[2], p[0], q) > 1e-6) centres[static_cast<uint32_t>(y * size + x)].push_back(t);
      }
    }
  }
  size_t shared = 0;
  for (const auto& [pixel, triangles] : centres) shared += triangles.size() > 1;
  std::printf("  %zu charts, %.0f %% of the picture used, areas shrunk to %.2f at least, %zu of %zu texels shared\n", atlas.charts, 100 * flat / (size * size), shrunk, shared, centres.size());
  EXPECT_EQ(shared, 0u);
  EXPECT_GT(flat, 0.25 * size * size);
  EXPECT_GT(shrunk, 0.3);

  // Texels: each once, at the place of the triangle that the coordinates say, and all whose centre a triangle holds.
  std::map<uint32_t, uint32_t> owners;
  for (const TextureAtlas::Texel& texel : atlas.texels) {
    ASSERT_TRUE(owners.emplace(texel.pixel, texel.triangle).second) << "a texel twice";
    EXPECT_NEAR(texel.barycentric.x + texel.barycentric.y + texel.barycentric.z, 1, 1e-5);
    glm::dvec2 at(0.0);
    for (int k = 0; k < 3; ++k) at += double{texel.barycentric[k]} * glm::dvec2(atlas.uvs[atlas.triangles[texel.triangle][k]]) * double(size);
    EXPECT_LT(glm::distance(at, glm::dvec2(texel.pixel % size + 0.5, texel.pixel / size + 0.5)), 1.51);
  }
  for (const auto& [pixel, triangles] : centres) {
    ASSERT_TRUE(owners.contains(pixel));
    EXPECT_EQ(owners[pixel], triangles[0]);
  }

  // Bilinear reads inside a triangle never see what is not of its chart or its margin.
  const std::vector<glm::vec3> white(atlas.texels.size(), glm::vec3(1.0f));
  for (const float value : atlas_picture(atlas, white)) ASSERT_EQ(value, 1.0f);
  for (uint32_t t = 0; t < atlas.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) {
      const glm::dvec2 at = glm::dvec2(atlas.uvs[atlas.triangles[t][k]]) * double(size) - 0.5;
      for (int j = 0; j < 4; ++j) EXPECT_TRUE(owners.contains(static_cast<uint32_t>((std::floor(at.y) + (j >> 1)) * size + std::floor(at.x) + (j & 1))));
    }
  EXPECT_THROW(make_texture_atlas(mesh, 16), InputError) << "no room for the margins alone";
  EXPECT_THROW(make_texture_atlas({}, 64), std::invalid_argument);
}

ColoredMesh tetrahedron() {
  ColoredMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 0.1f, 0}, {0, 0, 0.30000001f}};
  mesh.normals = {{-1, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.colors = {{0, 0, 0}, {1, 0, 0}, {0, 0.5f, 0}, {0, 0, 1.2f}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  return mesh;
}

TEST(MeshFilesTest, APlyReadsBackExactly) {
  const ColoredMesh mesh = tetrahedron();
  const std::vector<std::uint8_t> bytes = ply_file(mesh, "a note");
  const std::string text(bytes.begin(), bytes.end());
  const size_t end = text.find("end_header\n") + 11;
  EXPECT_EQ(text.substr(0, end),
            "ply\nformat binary_little_endian 1.0\ncomment a note\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
            "property float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
            "element face 4\nproperty list uchar int vertex_indices\nend_header\n");
  ASSERT_EQ(bytes.size(), end + 4 * 27 + 4 * 13);
  for (size_t v = 0; v < 4; ++v) {
    float numbers[6];
    std::memcpy(numbers, &bytes[end + 27 * v], 24);
    EXPECT_EQ(glm::vec3(numbers[0], numbers[1], numbers[2]), mesh.vertices[v]);
    EXPECT_EQ(glm::vec3(numbers[3], numbers[4], numbers[5]), mesh.normals[v]);
  }
  EXPECT_EQ(bytes[end + 27 * 2 + 25], 128);  // green of the third
  EXPECT_EQ(bytes[end + 27 * 3 + 26], 255) << "above 1";
  const size_t face = end + 4 * 27 + 13;
  int32_t corners[3];
  std::memcpy(corners, &bytes[face + 1], 12);
  EXPECT_EQ(bytes[face], 3);
  EXPECT_EQ(std::vector<int32_t>(corners, corners + 3), (std::vector<int32_t>{0, 1, 3}));

  ColoredMesh points = mesh;
  points.triangles.clear(), points.colors.clear();
  const std::vector<std::uint8_t> cloud = ply_file(points, "x");
  EXPECT_EQ(std::string(cloud.begin(), cloud.end()).find("face"), std::string::npos);
  points.normals.pop_back();
  EXPECT_THROW(ply_file(points, "x"), std::invalid_argument);
}

TEST(MeshFilesTest, AnObjReadsBackExactly) {
  const ColoredMesh mesh = tetrahedron();
  const std::vector<std::uint8_t> bytes = obj_file(mesh, "a note");
  std::istringstream lines(std::string(bytes.begin(), bytes.end()));
  std::vector<glm::vec3> vertices, normals;
  std::vector<std::string> faces;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string word;
    glm::vec3 v;
    words >> word;
    if (word == "f") faces.push_back(line);
    if (word != "v" && word != "vn") continue;
    words >> v.x >> v.y >> v.z;
    (word == "v" ? vertices : normals).push_back(v);
  }
  EXPECT_EQ(vertices, mesh.vertices);
  EXPECT_EQ(normals, mesh.normals);
  EXPECT_EQ(faces, (std::vector<std::string>{"f 1//1 3//3 2//2", "f 1//1 2//2 4//4", "f 1//1 4//4 3//3", "f 2//2 3//3 4//4"}));
  EXPECT_THAT(std::string(bytes.begin(), bytes.end()), testing::HasSubstr("v 0 0.1 0 0.0000 0.5000 0.0000\n"));
}

TEST(MeshFilesTest, PointsLieEvenlyOnTheSurface) {
  const ColoredMesh mesh = tetrahedron();
  const ColoredMesh points = sampled_points(mesh, 20000, 7), again = sampled_points(mesh, 20000, 7), other = sampled_points(mesh, 20000, 8);
  EXPECT_EQ(points.vertices, again.vertices);
  EXPECT_NE(points.vertices, other.vertices);
  ASSERT_EQ(points.vertices.size(), 20000u);
  ASSERT_EQ(points.colors.size(), 20000u);
  EXPECT_TRUE(points.triangles.empty());
  // By face, as its area; and within a face evenly: the mean is the face's middle.
  std::array<double, 4> areas{}, counts{};
  std::array<glm::dvec3, 4> means{};
  double all = 0;
  for (size_t t = 0; t < 4; ++t) {
    const glm::uvec3& c = mesh.triangles[t];
    areas[t] = glm::length(glm::cross(mesh.vertices[c.y] - mesh.vertices[c.x], mesh.vertices[c.z] - mesh.vertices[c.x])) / 2;
    all += areas[t];
  }
  for (const glm::vec3& p : points.vertices) {
    const size_t t = p.z < 1e-6f ? 0 : p.y < 1e-6f ? 1 : p.x < 1e-6f ? 2 : 3;
    EXPECT_TRUE(t < 3 || std::abs(p.x + p.y / 0.1f + p.z / 0.3f - 1) < 1e-4f) << "off the surface";
    ++counts[t];
    means[t] += glm::dvec3(p);
  }
  for (size_t t = 0; t < 4; ++t) {
    const double expected = 20000 * areas[t] / all;
    EXPECT_NEAR(counts[t], expected, 4 * std::sqrt(expected)) << t;
    glm::dvec3 middle(0.0);
    for (int k = 0; k < 3; ++k) middle += glm::dvec3(mesh.vertices[mesh.triangles[t][k]]) / 3.0;
    EXPECT_LT(glm::distance(means[t] / counts[t], middle), 0.02) << t;
  }
}

}  // namespace
}  // namespace arah
