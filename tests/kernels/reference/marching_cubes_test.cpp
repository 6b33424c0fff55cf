// Marching cubes against what is known of closed surfaces: their edges, their genus, their volume.
#include "kernels/reference/marching_cubes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "kernels/meshing/cube_cases.h"
#include "tests/kernels/marching_scene.h"

namespace arah::reference {
namespace {

using Edge = std::pair<uint32_t, uint32_t>;

std::map<Edge, int> directed_edges(const MarchedSurface& surface) {
  std::map<Edge, int> edges;
  for (const auto& t : surface.triangles)
    for (size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  return edges;
}

void expect_closed(const MarchedSurface& surface) {
  const std::map<Edge, int> edges = directed_edges(surface);
  int open = 0;
  for (const auto& [edge, times] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    if (back == edges.end() || back->second != times) ++open;
  }
  EXPECT_EQ(open, 0) << "of " << edges.size() << " edges";
}

// Vertices − edges + triangles of a closed surface.
long euler_number(const MarchedSurface& surface) { return static_cast<long>(surface.vertices.size()) - static_cast<long>(directed_edges(surface).size()) / 2 + static_cast<long>(surface.triangles.size()); }

double volume(const MarchedSurface& surface) {
  double sum = 0;
  for (const auto& t : surface.triangles) {
    const auto &a = surface.vertices[t[0]], &b = surface.vertices[t[1]], &c = surface.vertices[t[2]];
    sum += (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])) / 6;
  }
  return sum;
}

TEST(CubeCases, ComplementsAndTheirNumbers) {
  EXPECT_EQ(cube_case(0).triangles, 0);
  EXPECT_EQ(cube_case(255).triangles, 0);
  EXPECT_EQ(cube_case(1).triangles, 1);
  EXPECT_EQ(cube_case(0b10000001).triangles, 2) << "two corners across the cube: two triangles, apart";
  EXPECT_EQ(cube_case(0b00001001).triangles, 2) << "two corners across a face stay apart";
  EXPECT_EQ(cube_case(0b00001111).triangles, 2) << "a flat cut";
  int most = 0;
  for (const CubeCase& cut : cube_cases()) most = std::max<int>(most, cut.triangles);
  EXPECT_EQ(most, 5);
  for (uint32_t edge = 0; edge < 12; ++edge) EXPECT_EQ(cube_edge_between(cube_edge_corner(edge), cube_edge_corner(edge) | 1u << cube_edge_axis(edge)), edge);
}

// Each of the crossed edges of each case has triangles, and only these.
TEST(CubeCases, UseTheEdgesThatAreCrossed) {
  for (uint32_t inside = 0; inside < 256; ++inside) {
    const CubeCase cut = cube_case(inside);
    uint32_t used = 0, crossed = 0;
    for (size_t i = 0; i < 3u * cut.triangles; ++i) used |= 1u << cut.edges[i];
    for (uint32_t edge = 0; edge < 12; ++edge) {
      const uint32_t corner = cube_edge_corner(edge);
      if ((inside >> corner & 1) != (inside >> (corner | 1u << cube_edge_axis(edge)) & 1)) crossed |= 1u << edge;
    }
    EXPECT_EQ(used, crossed) << inside;
  }
}

// No two of the 256 cases leave a hole between them, whatever lies beside what: nodes in and out at random.
TEST(MarchingCubes, CloseWhateverLiesBesideWhat) {
  std::mt19937_64 generator{5};
  for (const double share : {0.1, 0.5, 0.8}) {
    MarchingScene scene({14, 13, 12}, 1.0, [&](const std::array<double, 3>&) { return std::bernoulli_distribution(share)(generator) ? -0.5 : 0.7; });
    scene.close();
    const MarchedSurface surface = marching_cubes(scene.nodes, scene.corners);
    EXPECT_GT(surface.triangles.size(), 1000u);
    expect_closed(surface);
    EXPECT_GT(volume(surface), 0);
  }
}

TEST(MarchingCubes, ASphereHasItsVolumeAndATorusItsHole) {
  const double radius = 0.4;
  for (const int across : {16, 64}) {
    const double cell = 1.0 / across;
    MarchingScene scene({across + 1, across + 1, across + 1}, cell, [&](const std::array<double, 3>& p) { return std::hypot(p[0] - 0.5, p[1] - 0.5, p[2] - 0.5) - radius; });
    const MarchedSurface surface = marching_cubes(scene.nodes, scene.corners);
    expect_closed(surface);
    EXPECT_EQ(euler_number(surface), 2);
    const double exact = 4.0 / 3 * 3.14159265358979 * radius * radius * radius;
    std::printf("  sphere, cell %.4f: volume off by %.1e of it\n", cell, 1 - volume(surface) / exact);
    // Vertices lie on the sphere to h² / 8R, triangles a little inside: the volume is short by less than h² / R² of it.
    EXPECT_LT(std::abs(1 - volume(surface) / exact), cell * cell / radius / radius);
    for (const auto& v : surface.vertices) EXPECT_NEAR(std::hypot(v[0] - 0.5, v[1] - 0.5, v[2] - 0.5), radius, cell * cell / 8 / radius * 1.1 + cell * least_edge_part);
  }
  MarchingScene torus({33, 33, 17}, 1.0 / 32, [](const std::array<double, 3>& p) { return std::hypot(std::hypot(p[0] - 0.5, p[1] - 0.5) - 0.3, p[2] - 0.25) - 0.1; });
  const MarchedSurface surface = marching_cubes(torus.nodes, torus.corners);
  expect_closed(surface);
  EXPECT_EQ(euler_number(surface), 0);
}

// Nodes that lie exactly on the surface, where interpolation alone would give triangles without area.
TEST(MarchingCubes, KeepTheirAreaWhereTheSurfaceMeetsNodes) {
  MarchingScene box({9, 9, 9}, 0.125, [](const std::array<double, 3>& p) { return std::max({std::abs(p[0] - 0.5), std::abs(p[1] - 0.5), std::abs(p[2] - 0.5)}) - 0.25; });
  const MarchedSurface surface = marching_cubes(box.nodes, box.corners);
  expect_closed(surface);
  EXPECT_EQ(euler_number(surface), 2);
  for (const auto& t : surface.triangles) {
    std::array<double, 3> u{}, v{};
    for (size_t k = 0; k < 3; ++k) {
      u[k] = surface.vertices[t[1]][k] - surface.vertices[t[0]][k];
      v[k] = surface.vertices[t[2]][k] - surface.vertices[t[0]][k];
    }
    EXPECT_GT(std::hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]), 1e-9);
  }
}

TEST(MarchingCubes, RefuseASetOfCubesWithAHole) {
  MarchingScene scene({9, 9, 9}, 0.125, [](const std::array<double, 3>& p) { return std::hypot(p[0] - 0.5, p[1] - 0.5, p[2] - 0.5) - 0.3; });
  EXPECT_NO_THROW(marching_cubes(scene.nodes, scene.corners));
  scene.make_a_hole();
  EXPECT_THROW(marching_cubes(scene.nodes, scene.corners), std::invalid_argument);
}

}  // namespace
}  // namespace arah::reference
