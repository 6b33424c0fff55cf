#include "host/capture/implicit_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace arah {

double signed_distance(const TaperedCapsule& capsule, const glm::dvec3& point) {
  const glm::dvec3 q = (point - capsule.a) / capsule.stretch;
  const glm::dvec3 axis = (capsule.b - capsule.a) / capsule.stretch;
  const double length2 = glm::dot(axis, axis);
  const double t = length2 > 0 ? std::clamp(glm::dot(q, axis) / length2, 0.0, 1.0) : 0.0;
  const glm::dvec3 away = q - t * axis;
  const double distance = glm::length(away);
  const double radius = capsule.radius_a + t * (capsule.radius_b - capsule.radius_a);
  if (distance < 1e-9) return -radius * std::min({capsule.stretch.x, capsule.stretch.y, capsule.stretch.z});
  // d/dpoint of |away| is S^-1 (away / |away|); dividing by its length makes the value a distance to first order.
  return (distance - radius) * distance / glm::length(away / capsule.stretch);
}

double smooth_minimum(double x, double y, double blend) {
  const double h = std::max(blend - std::abs(x - y), 0.0) / blend;
  return std::min(x, y) - 0.25 * blend * h * h;
}

namespace {

// Values at the nodes of the box [low, high]; blocks of nodes far from the zero set get the value at their centre.
FieldSamples<double> sample_field(const ImplicitField& field, const glm::dvec3& low, const glm::dvec3& high, double cell) {
  FieldSamples<double> grid{low, cell, glm::ivec3(glm::ceil((high - low) / cell)) + 1, {}};
  const glm::ivec3 n = grid.nodes;
  grid.values.resize(static_cast<std::size_t>(n.x) * static_cast<std::size_t>(n.y) * static_cast<std::size_t>(n.z));
  constexpr int block = 4;
  // One and a half times the half diagonal: the field is a distance only to first order, so its slope may exceed 1 away
  // from the zero set.
  const double reach = 1.5 * 0.5 * std::sqrt(3.0) * block * cell;
  for (int z0 = 0; z0 < n.z; z0 += block)
    for (int y0 = 0; y0 < n.y; y0 += block)
      for (int x0 = 0; x0 < n.x; x0 += block) {
        const double centre = field(grid.position(x0, y0, z0) + 0.5 * (block - 1) * cell);
        const bool far = std::abs(centre) > reach;
        for (int z = z0; z < std::min(z0 + block, n.z); ++z)
          for (int y = y0; y < std::min(y0 + block, n.y); ++y)
            for (int x = x0; x < std::min(x0 + block, n.x); ++x)
              grid.values[grid.index(x, y, z)] = far ? centre : field(grid.position(x, y, z));
      }
  return grid;
}

// Whether the eight corners of a cell lie on both sides of the surface.
template <typename Value>
bool crosses(const FieldSamples<Value>& grid, int x, int y, int z) {
  const std::size_t corner = grid.index(x, y, z), row = static_cast<std::size_t>(grid.nodes.x);
  const std::size_t layer = row * static_cast<std::size_t>(grid.nodes.y);
  int inside = 0;
  for (const std::size_t shift : {std::size_t{0}, row, layer, layer + row})
    inside += (grid.values[corner + shift] < 0 ? 1 : 0) + (grid.values[corner + shift + 1] < 0 ? 1 : 0);
  return inside != 0 && inside != 8;
}

// The vertex of a cell that the surface crosses: the mean of the crossings on its twelve edges.
template <typename Value>
glm::dvec3 cell_vertex(const FieldSamples<Value>& grid, int x, int y, int z) {
  glm::dvec3 sum(0);
  int crossings = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 4; ++side) {
      glm::ivec3 from(x, y, z);
      from[(axis + 1) % 3] += side & 1;
      from[(axis + 2) % 3] += side >> 1;
      glm::ivec3 to = from;
      to[axis] += 1;
      const double f = grid.values[grid.index(from.x, from.y, from.z)];
      const double g = grid.values[grid.index(to.x, to.y, to.z)];
      if ((f < 0) == (g < 0)) continue;
      sum += glm::mix(grid.position(from.x, from.y, from.z), grid.position(to.x, to.y, to.z), f / (f - g));
      ++crossings;
    }
  return sum / static_cast<double>(crossings);
}

// One Newton step onto the zero set, at most half a cell long.
glm::dvec3 towards_zero_set(const ImplicitField& field, const glm::dvec3& point, double cell) {
  const double h = 0.01 * cell, value = field(point);
  glm::dvec3 gradient;
  for (int axis = 0; axis < 3; ++axis) {
    glm::dvec3 beside = point;
    beside[axis] += h;
    gradient[axis] = (field(beside) - value) / h;
  }
  const double slope2 = glm::dot(gradient, gradient);
  if (slope2 < 1e-6) return point;
  const glm::dvec3 step = -value / slope2 * gradient;
  const double length = glm::length(step);
  return point + (length > 0.5 * cell ? step * (0.5 * cell / length) : step);
}

}  // namespace

std::vector<std::vector<std::uint32_t>> vertex_neighbours(std::size_t vertices,
                                                          const std::vector<glm::uvec3>& triangles) {
  std::vector<std::vector<std::uint32_t>> neighbours(vertices);
  for (const glm::uvec3& triangle : triangles)
    for (int k = 0; k < 3; ++k) {
      neighbours[triangle[k]].push_back(triangle[(k + 1) % 3]);
      neighbours[triangle[(k + 1) % 3]].push_back(triangle[k]);
    }
  for (auto& list : neighbours) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  return neighbours;
}

template <typename Value>
double FieldSamples<Value>::between(const glm::dvec3& point) const {
  const glm::dvec3 place = glm::clamp((point - low) / cell, glm::dvec3(0.0), glm::dvec3(nodes - 1));
  const glm::ivec3 corner = glm::min(glm::ivec3(place), nodes - 2);
  const glm::dvec3 part = place - glm::dvec3(corner);
  double layers[2];
  for (int z = 0; z < 2; ++z) {
    double lines[2];
    for (int y = 0; y < 2; ++y) {
      const std::size_t first = index(corner.x, corner.y + y, corner.z + z);
      lines[y] = glm::mix(double{values[first]}, double{values[first + 1]}, part.x);
    }
    layers[z] = glm::mix(lines[0], lines[1], part.y);
  }
  return glm::mix(layers[0], layers[1], part.z);
}

TriangleMesh mesh_zero_set(const ImplicitField& field, const glm::dvec3& low, const glm::dvec3& high, double cell) {
  TriangleMesh mesh = surface_nets(sample_field(field, low, high, cell));
  constexpr int rounds = 3;
  even_out(mesh, field, cell, rounds);
  return mesh;
}

template <typename Value>
TriangleMesh surface_nets(const FieldSamples<Value>& grid) {
  const glm::ivec3 n = grid.nodes;
  constexpr std::uint32_t none = ~0u;
  TriangleMesh mesh;
  std::vector<std::uint32_t> vertex_of_cell(grid.values.size(), none);
  for (int z = 0; z + 1 < n.z; ++z)
    for (int y = 0; y + 1 < n.y; ++y)
      for (int x = 0; x + 1 < n.x; ++x) {
        if (!crosses(grid, x, y, z)) continue;
        vertex_of_cell[grid.index(x, y, z)] = static_cast<std::uint32_t>(mesh.vertices.size());
        mesh.vertices.push_back(cell_vertex(grid, x, y, z));
      }

  // Every grid edge that the surface crosses joins the vertices of its four cells.
  const std::size_t stride[3] = {1, static_cast<std::size_t>(n.x),
                                 static_cast<std::size_t>(n.x) * static_cast<std::size_t>(n.y)};
  const auto join = [&](const glm::ivec3& node, int axis) {
    const std::size_t at = grid.index(node.x, node.y, node.z);
    const bool inside = grid.values[at] < 0;
    if (inside == (grid.values[at + stride[axis]] < 0)) return;
    glm::ivec3 du(0), dv(0);
    du[(axis + 1) % 3] = 1;
    dv[(axis + 2) % 3] = 1;
    const auto vertex = [&](const glm::ivec3& c) { return vertex_of_cell[grid.index(c.x, c.y, c.z)]; };
    std::array<std::uint32_t, 4> quad = {vertex(node - du - dv), vertex(node - dv), vertex(node), vertex(node - du)};
    if (!inside) std::swap(quad[1], quad[3]);
    const auto length = [&](int i, int j) { return glm::distance(mesh.vertices[quad[i]], mesh.vertices[quad[j]]); };
    if (length(0, 2) <= length(1, 3)) {
      mesh.triangles.emplace_back(quad[0], quad[1], quad[2]);
      mesh.triangles.emplace_back(quad[0], quad[2], quad[3]);
    } else {
      mesh.triangles.emplace_back(quad[1], quad[2], quad[3]);
      mesh.triangles.emplace_back(quad[1], quad[3], quad[0]);
    }
  };
  for (int z = 1; z + 1 < n.z; ++z)
    for (int y = 1; y + 1 < n.y; ++y)
      for (int x = 1; x + 1 < n.x; ++x)
        for (int axis = 0; axis < 3; ++axis) join({x, y, z}, axis);

  return mesh;
}

template struct FieldSamples<float>;
template TriangleMesh surface_nets(const FieldSamples<float>& grid);

void even_out(TriangleMesh& mesh, const ImplicitField& field, double cell, int rounds) {
  const auto neighbours = vertex_neighbours(mesh.vertices.size(), mesh.triangles);
  for (int round = 0; round < rounds; ++round) {
    std::vector<glm::dvec3> evened = mesh.vertices;
    for (std::size_t i = 0; i < evened.size(); ++i) {
      if (neighbours[i].empty()) continue;
      glm::dvec3 mean(0);
      for (const std::uint32_t j : neighbours[i]) mean += mesh.vertices[j];
      mean /= static_cast<double>(neighbours[i].size());
      evened[i] = towards_zero_set(field, glm::mix(mesh.vertices[i], mean, 0.5), cell);
    }
    mesh.vertices = std::move(evened);
  }
}

TriangleMesh without_small_parts(const TriangleMesh& mesh, double least_part) {
  std::vector<std::uint32_t> parent(mesh.vertices.size());
  for (std::uint32_t v = 0; v < parent.size(); ++v) parent[v] = v;
  const auto root = [&](std::uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const glm::uvec3& t : mesh.triangles) parent[root(t.y)] = root(t.x), parent[root(t.z)] = root(t.x);
  std::vector<std::uint32_t> sizes(parent.size(), 0), places(parent.size(), 0);
  for (std::uint32_t v = 0; v < parent.size(); ++v) ++sizes[root(v)];
  const double least = sizes.empty() ? 0 : least_part * *std::max_element(sizes.begin(), sizes.end());
  TriangleMesh kept;
  for (std::uint32_t v = 0; v < parent.size(); ++v) {
    places[v] = static_cast<std::uint32_t>(kept.vertices.size());
    if (sizes[root(v)] >= least) kept.vertices.push_back(mesh.vertices[v]);
  }
  for (const glm::uvec3& t : mesh.triangles)
    if (sizes[root(t.x)] >= least) kept.triangles.emplace_back(places[t.x], places[t.y], places[t.z]);
  return kept;
}

std::vector<glm::dvec3> vertex_normals(const std::vector<glm::dvec3>& vertices,
                                       const std::vector<glm::uvec3>& triangles) {
  std::vector<glm::dvec3> normals(vertices.size(), glm::dvec3(0));
  for (const glm::uvec3& t : triangles) {
    const glm::dvec3 area = glm::cross(vertices[t.y] - vertices[t.x], vertices[t.z] - vertices[t.x]);
    for (int k = 0; k < 3; ++k) normals[t[k]] += area;
  }
  for (glm::dvec3& normal : normals) {
    const double length = glm::length(normal);
    normal = length > 0 ? normal / length : glm::dvec3(0, 1, 0);
  }
  return normals;
}

CutTriangles cut_triangles(const std::vector<glm::uvec3>& triangles, const std::vector<double>& value_at_vertex) {
  CutTriangles cut;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> known;
  // A kept vertex has first == second; a new one lies on the edge (first, second), always named in ascending order so
  // that both triangles of the edge share it.
  const auto vertex = [&](std::uint32_t i, std::uint32_t j) {
    const std::uint32_t first = std::min(i, j), second = std::max(i, j);
    const auto [entry, fresh] = known.try_emplace({first, second}, static_cast<std::uint32_t>(cut.vertices.size()));
    if (fresh) {
      const double f = value_at_vertex[first], g = value_at_vertex[second];
      cut.vertices.push_back({first, second, first == second ? 0.0 : f / (f - g)});
    }
    return entry->second;
  };
  for (const glm::uvec3& triangle : triangles) {
    std::vector<std::uint32_t> polygon;
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t i = triangle[k], j = triangle[(k + 1) % 3];
      const bool keep_i = value_at_vertex[i] >= 0, keep_j = value_at_vertex[j] >= 0;
      if (keep_i) polygon.push_back(vertex(i, i));
      if (keep_i != keep_j) polygon.push_back(vertex(i, j));
    }
    for (std::size_t k = 2; k < polygon.size(); ++k) cut.triangles.emplace_back(polygon[0], polygon[k - 1], polygon[k]);
  }
  return cut;
}

}  // namespace arah
