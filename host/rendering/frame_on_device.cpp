#include "host/rendering/frame_on_device.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "host/body/canonical.h"
#include "host/body/pose.h"
#include "shaders/shared/frame.h"

namespace arah {
namespace {

constexpr double box_margin = 0.05;  // metres (ARAH.md §4)

// Vertex normals of a triangle mesh, weighted by the triangles' areas, not of unit length.
std::vector<glm::dvec3> vertex_normals(const std::vector<glm::dvec3>& vertices, const std::vector<glm::uvec3>& triangles) {
  std::vector<glm::dvec3> sums(vertices.size(), glm::dvec3(0));
  for (const glm::uvec3& t : triangles) {
    const glm::dvec3 normal = glm::cross(vertices[t.y] - vertices[t.x], vertices[t.z] - vertices[t.x]);
    for (int corner = 0; corner < 3; ++corner) sums[t[corner]] += normal;
  }
  return sums;
}

// Signed distance to the nearest vertex at the grid's nodes, metres, negative where the node lies behind the vertex' normal;
// `reach` at nodes that no vertex is nearer to. Each vertex visits the nodes around it: tens of milliseconds a frame, where
// asking every node for its nearest vertex takes a second on a CPU device (most nodes are far from the body).
std::vector<float> distances_of_nodes(const ShellGrid& grid, const std::vector<std::array<float, 3>>& vertices, const std::vector<glm::dvec3>& normals, double reach) {
  const uint32_t count = node_count(grid);
  std::vector<float> nearest(padded_points(count), static_cast<float>(reach * reach)), signs(nearest.size(), 1.0f);
  const glm::dvec3 origin(grid.origin[0], grid.origin[1], grid.origin[2]);
  const double cell = grid.cell;
  for (size_t v = 0; v < vertices.size(); ++v) {
    const glm::dvec3 p(vertices[v][0], vertices[v][1], vertices[v][2]);
    glm::uvec3 first, last;
    for (int axis = 0; axis < 3; ++axis) {
      const double most = double(grid.nodes[axis]) - 1;
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

template <typename T>
Buffer uploaded(Device& device, const std::string& name, const std::vector<T>& values) {
  Buffer buffer(device, name, std::max<uint64_t>(values.size() * sizeof(T), 16), BufferPlace::device);
  device.upload(buffer.slice(), values);
  return buffer;
}

}  // namespace

TemplateOnDevice::TemplateOnDevice(Device& device, const BodyTemplate& body) {
  std::vector<uint32_t> joints;
  std::vector<std::array<float, 4>> weights;
  for (size_t v = 0; v < body.vertices.size(); ++v) {
    const auto& j = body.joints[v];
    joints.push_back(uint32_t(j.x) | uint32_t(j.y) << 8 | uint32_t(j.z) << 16 | uint32_t(j.w) << 24);
    weights.push_back({body.weights[v].x, body.weights[v].y, body.weights[v].z, body.weights[v].w});
  }
  joints_ = uploaded(device, "template joints", joints);
  weights_ = uploaded(device, "template weights", weights);
}

FrameOnDevice::FrameOnDevice(Device& device, const Avatar& avatar, TemplateOnDevice& body, const Pose& pose, const ShellSettings& shell) {
  const std::vector<glm::dmat4> bones = bone_transforms(avatar.body.skeleton, avatar.canonical, pose);
  const glm::dvec3 t = arah::root_translation(avatar.body.skeleton, pose);

  FrameConstants constants{};
  const double scale = 1.0 / avatar.cube.metres_per_unit();
  const glm::dvec3 offset = avatar.cube.to_cube(glm::dvec3(0));
  constants.cube_scale = static_cast<float>(scale);
  constants.joint_count = static_cast<uint32_t>(bones.size());
  for (int axis = 0; axis < 3; ++axis) {
    constants.cube_offset[axis] = static_cast<float>(offset[axis]);
    constants.root_translation[axis] = root_translation_[static_cast<size_t>(axis)] = static_cast<float>(t[axis]);
  }
  for (size_t j = 0; j < bones.size(); ++j)
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column) constants.bones[3 * j + static_cast<size_t>(row)][column] = static_cast<float>(bones[j][column][row]);
  constants_ = Buffer(device, "frame constants", sizeof constants, BufferPlace::device);
  device.upload(constants_.slice(), &constants, sizeof constants);

  // Posed vertices without the root translation: A_b = B_b V_b on the rest vertices.
  const std::vector<glm::dvec3> posed = skinned_vertices(avatar.body, rest_to_posed(avatar.body.skeleton, pose));
  std::vector<std::array<float, 3>> points;
  glm::dvec3 lower = posed.front(), upper = posed.front();
  for (const glm::dvec3& p : posed) {
    lower = glm::min(lower, p), upper = glm::max(upper, p);
    points.push_back({static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
  }
  for (int axis = 0; axis < 3; ++axis) {
    box_.minimum[static_cast<size_t>(axis)] = static_cast<float>(lower[axis] + t[axis] - box_margin);
    box_.maximum[static_cast<size_t>(axis)] = static_cast<float>(upper[axis] + t[axis] + box_margin);
  }
  vertices_.grid = build_vertex_grid(points);
  grid_vertices_ = uploaded(device, "posed vertices by cell", vertices_.grid.vertices);
  cell_start_ = uploaded(device, "cell starts", vertices_.grid.cell_start);
  cell_seed_ = uploaded(device, "cell seeds", vertices_.grid.cell_seed);
  vertices_.vertices = grid_vertices_.slice();
  vertices_.cell_start = cell_start_.slice();
  vertices_.cell_seed = cell_seed_.slice();
  vertices_.joints = body.joints();
  vertices_.weights = body.weights();

  // The grid of distances; a very large body gets larger cells rather than millions of nodes.
  const glm::dvec3 size = upper - lower + 2 * shell.margin;
  double cell = shell.cell;
  while ((size.x / cell + 2) * (size.y / cell + 2) * (size.z / cell + 2) > (1 << 20)) cell *= 1.25;
  shell_grid_.cell = static_cast<float>(cell);
  const glm::dvec3 origin = lower - shell.margin;
  shell_grid_.origin = {static_cast<float>(origin.x), static_cast<float>(origin.y), static_cast<float>(origin.z)};
  for (int axis = 0; axis < 3; ++axis) shell_grid_.nodes[axis] = static_cast<uint32_t>(std::ceil(size[axis] / cell)) + 1;

  shell_distances_ = uploaded(device, "shell distances", distances_of_nodes(shell_grid_, points, vertex_normals(posed, avatar.body.triangles), shell.outer + shell.margin));
  // The search tables live on the device now.
  vertices_.grid.vertices.clear(), vertices_.grid.cell_start.clear(), vertices_.grid.cell_seed.clear();
}

uint64_t FrameOnDevice::bytes() const {
  return constants_.bytes() + grid_vertices_.bytes() + cell_start_.bytes() + cell_seed_.bytes() + shell_distances_.bytes() + (correspondences_ ? correspondences_->bytes() : 0);
}

}  // namespace arah
