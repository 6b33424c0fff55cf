#include "host/rendering/template_distances.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "kernels/linear/matrix.h"
#include "kernels/rays/shell_bins.h"

namespace arah {
namespace {

// Vertex normals of a triangle mesh, weighted by the triangles' areas, not of unit length.
std::vector<glm::dvec3> area_normals(const std::vector<glm::dvec3>& vertices, const std::vector<glm::uvec3>& triangles) {
  std::vector<glm::dvec3> sums(vertices.size(), glm::dvec3(0));
  for (const glm::uvec3& t : triangles) {
    const glm::dvec3 normal = glm::cross(vertices[t.y] - vertices[t.x], vertices[t.z] - vertices[t.x]);
    for (int corner = 0; corner < 3; ++corner) sums[t[corner]] += normal;
  }
  return sums;
}

}  // namespace

shared::ShellGrid grid_around(const std::vector<glm::dvec3>& vertices, double margin, double cell, double most_nodes) {
  glm::dvec3 lower = vertices.front(), upper = vertices.front();
  for (const glm::dvec3& p : vertices) lower = glm::min(lower, p), upper = glm::max(upper, p);
  const glm::dvec3 size = upper - lower + 2 * margin;
  while ((size.x / cell + 2) * (size.y / cell + 2) * (size.z / cell + 2) > most_nodes) cell *= 1.25;
  shared::ShellGrid grid;
  grid.cell = static_cast<float>(cell);
  for (int axis = 0; axis < 3; ++axis) {
    grid.origin[static_cast<size_t>(axis)] = static_cast<float>(lower[axis] - margin);
    grid.nodes[static_cast<size_t>(axis)] = static_cast<uint32_t>(std::ceil(size[axis] / cell)) + 1;
  }
  return grid;
}

// Each vertex visits the nodes around it: tens of milliseconds, where asking every node for its nearest vertex takes a second
// on a CPU device (most nodes are far from the body).
std::vector<float> template_distances(const shared::ShellGrid& grid, const std::vector<glm::dvec3>& vertices, const std::vector<glm::uvec3>& triangles, double reach) {
  const std::vector<glm::dvec3> normals = area_normals(vertices, triangles);
  std::vector<float> nearest(padded_points(node_count(grid)), static_cast<float>(reach * reach)), signs(nearest.size(), 1.0f);
  const glm::dvec3 origin(grid.origin[0], grid.origin[1], grid.origin[2]);
  const auto cell = double{grid.cell};
  for (size_t v = 0; v < vertices.size(); ++v) {
    const glm::dvec3 p = vertices[v];
    glm::uvec3 first, last;
    for (int axis = 0; axis < 3; ++axis) {
      const double most = double(grid.nodes[static_cast<size_t>(axis)]) - 1;
      first[axis] = static_cast<uint32_t>(std::clamp(std::ceil((p[axis] - reach - origin[axis]) / cell), 0.0, most));
      last[axis] = static_cast<uint32_t>(std::clamp(std::floor((p[axis] + reach - origin[axis]) / cell), 0.0, most));
    }
    for (uint32_t z = first.z; z <= last.z; ++z)
      for (uint32_t y = first.y; y <= last.y; ++y)
        for (uint32_t x = first.x; x <= last.x; ++x) {
          const glm::dvec3 from = origin + cell * glm::dvec3(x, y, z) - p;
          const auto squared = static_cast<float>(glm::dot(from, from));
          const size_t node = (size_t(z) * grid.nodes[1] + y) * grid.nodes[0] + x;
          if (squared >= nearest[node]) continue;
          nearest[node] = squared;
          signs[node] = glm::dot(from, normals[v]) < 0 ? -1.0f : 1.0f;
        }
  }
  for (size_t node = 0; node < nearest.size(); ++node) nearest[node] = signs[node] * std::sqrt(nearest[node]);
  return nearest;
}

}  // namespace arah
