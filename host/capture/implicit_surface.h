// Closed surfaces from implicit shapes: tapered capsules joined smoothly, meshed by surface nets. The synthetic figure
// is built of them.
#pragma once

#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <vector>

namespace arah {

// A capsule from `a` (radius `radius_a`) to `b` (radius `radius_b`), metres, seen through per-axis `stretch` factors
// about `a`: stretch (1, 1, 0.5) halves its depth along z. a == b gives an ellipsoid.
struct TaperedCapsule {
  glm::dvec3 a, b;
  double radius_a = 0, radius_b = 0;
  glm::dvec3 stretch = glm::dvec3(1);
};

// Signed distance to first order (negative inside), metres: the implicit value divided by the length of its gradient.
double signed_distance(const TaperedCapsule& capsule, const glm::dvec3& point);

// Polynomial smooth minimum: equals min(x, y) where |x - y| >= blend, and is at most blend / 4 below it elsewhere.
// blend > 0, metres.
double smooth_minimum(double x, double y, double blend);

// An implicit shape: negative inside, near its zero set roughly a distance in metres.
using ImplicitField = std::function<double(const glm::dvec3&)>;

struct TriangleMesh {
  std::vector<glm::dvec3> vertices;
  std::vector<glm::uvec3> triangles;  // counter-clockwise seen from outside
};

// Values of a field, float or double, at the nodes of a box of cubes: node (x, y, z) lies at low + cell · (x, y, z).
template <typename Value>
struct FieldSamples {
  glm::dvec3 low{0.0};
  double cell = 1;  // metres
  glm::ivec3 nodes{0};
  std::vector<Value> values;  // x first, z last

  std::size_t index(int x, int y, int z) const {
    return static_cast<std::size_t>(x) + static_cast<std::size_t>(nodes.x) * (static_cast<std::size_t>(y) + static_cast<std::size_t>(nodes.y) * static_cast<std::size_t>(z));
  }
  glm::dvec3 position(int x, int y, int z) const { return low + cell * glm::dvec3(x, y, z); }
  // Trilinear between the nodes; outside the box the nearest place of it answers.
  double between(const glm::dvec3& point) const;
};

// The zero set between the nodes by surface nets: one vertex in every cell that it crosses. It must not reach the box's
// faces. Parts thinner than two cells may be lost.
template <typename Value>
TriangleMesh surface_nets(const FieldSamples<Value>& samples);

// Evens the mesh out tangentially: every round moves each vertex halfway to its neighbours' mean and back onto the zero set of
// `field` by one Newton step of at most half a cell.
void even_out(TriangleMesh& mesh, const ImplicitField& field, double cell, int rounds);

// The zero set of `field` inside the box [low, high] (which must enclose it) by surface nets on cubes of edge `cell`
// (metres), evened out.
TriangleMesh mesh_zero_set(const ImplicitField& field, const glm::dvec3& low, const glm::dvec3& high, double cell);

// Without the connected parts that have fewer than least_part of the largest one's vertices: 0 keeps all, 1 the largest alone (those
// of them that are equally large).
TriangleMesh without_small_parts(const TriangleMesh& mesh, double least_part);

// Area-weighted unit normals, one a vertex; (0, 1, 0) where a vertex has no area around it.
std::vector<glm::dvec3> vertex_normals(const std::vector<glm::dvec3>& vertices,
                                       const std::vector<glm::uvec3>& triangles);

// Where a vertex of a cut mesh comes from: (1 - t) of vertex `first` plus t of vertex `second` of the mesh before the
// cut.
struct VertexOrigin {
  std::uint32_t first = 0, second = 0;
  double t = 0;
};

struct CutTriangles {
  std::vector<VertexOrigin> vertices;
  std::vector<glm::uvec3> triangles;
};

// Keeps the part of a mesh where the per-vertex value, interpolated linearly, is >= 0: triangles astride the line are
// split on it.
CutTriangles cut_triangles(const std::vector<glm::uvec3>& triangles, const std::vector<double>& value_at_vertex);

// Neighbours of every vertex along edges, ascending, each once.
std::vector<std::vector<std::uint32_t>> vertex_neighbours(std::size_t vertices,
                                                          const std::vector<glm::uvec3>& triangles);

}  // namespace arah
