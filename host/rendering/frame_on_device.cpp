#include "host/rendering/frame_on_device.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "host/body/canonical.h"
#include "host/body/pose.h"
#include "kernels/rays/shell_nodes.h"
#include "shaders/shared/frame.h"

namespace arah {
namespace {

constexpr double box_margin = 0.05;  // metres (ARAH.md §4)

// Vertex normals of a triangle mesh, weighted by the triangles' areas, not of unit length.
std::vector<std::array<float, 4>> vertex_normals(const std::vector<glm::dvec3>& vertices, const std::vector<glm::uvec3>& triangles) {
  std::vector<glm::dvec3> sums(vertices.size(), glm::dvec3(0));
  for (const glm::uvec3& t : triangles) {
    const glm::dvec3 normal = glm::cross(vertices[t.y] - vertices[t.x], vertices[t.z] - vertices[t.x]);
    for (int corner = 0; corner < 3; ++corner) sums[t[corner]] += normal;
  }
  std::vector<std::array<float, 4>> normals;
  for (const glm::dvec3& sum : sums) {
    // Areas of square millimetres would leave float32's comfortable range when squared.
    const glm::dvec3 unit = glm::length(sum) > 0 ? sum / glm::length(sum) : glm::dvec3(0, 0, 1);
    normals.push_back({static_cast<float>(unit.x), static_cast<float>(unit.y), static_cast<float>(unit.z), 0});
  }
  return normals;
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

  const uint32_t nodes = node_count(shell_grid_), rows = padded_points(nodes);
  shell_distances_ = Buffer(device, "shell distances", uint64_t(rows) * 4, BufferPlace::device);
  Buffer node_points(device, "shell nodes", uint64_t(rows) * 16, BufferPlace::device);
  Buffer starts(device, "shell starts", uint64_t(rows) * 16, BufferPlace::device);
  Buffer nearest(device, "shell nearest", uint64_t(rows) * 4, BufferPlace::device);
  std::vector<std::array<float, 4>> positions;
  for (const auto& p : points) positions.push_back({p[0], p[1], p[2], 0});
  Buffer positions_buffer = uploaded(device, "posed vertices", positions);
  Buffer normals = uploaded(device, "posed normals", vertex_normals(posed, avatar.body.triangles));
  Commands commands(device);
  record_shell_nodes(commands, {shell_grid_, node_points.slice()});
  NearestVertexArgs search;
  search.rows.range.points = nodes;
  search.frame = constants_.slice();
  search.posed = node_points.slice();
  search.target = vertices_;
  search.canonical = starts.slice();
  search.nearest = nearest.slice();
  record_nearest_vertex(commands, search);
  record_shell_distance(commands, {shell_grid_, static_cast<uint32_t>(positions.size()), nearest.slice(), positions_buffer.slice(), normals.slice(), shell_distances_.slice()});
  commands.submit_and_wait();
  // The search tables live on the device now.
  vertices_.grid.vertices.clear(), vertices_.grid.cell_start.clear(), vertices_.grid.cell_seed.clear();
}

uint64_t FrameOnDevice::bytes() const {
  return constants_.bytes() + grid_vertices_.bytes() + cell_start_.bytes() + cell_seed_.bytes() + shell_distances_.bytes();
}

}  // namespace arah
