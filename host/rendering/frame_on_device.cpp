#include "host/rendering/frame_on_device.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "host/body/canonical.h"
#include "host/body/pose.h"
#include "host/rendering/template_distances.h"

namespace arah {
namespace {

constexpr double box_margin = 0.05;  // metres (ARAH.md §4)

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

FrameConstants frame_constants(const CubeNormalization& cube, const std::vector<glm::dmat4>& bones, const glm::dvec3& t) {
  FrameConstants constants{};
  const double scale = 1.0 / cube.metres_per_unit();
  const glm::dvec3 offset = cube.to_cube(glm::dvec3(0));
  constants.cube_scale = static_cast<float>(scale);
  constants.joint_count = static_cast<uint32_t>(bones.size());
  for (int axis = 0; axis < 3; ++axis) {
    constants.cube_offset[axis] = static_cast<float>(offset[axis]);
    constants.root_translation[axis] = static_cast<float>(t[axis]);
  }
  for (size_t j = 0; j < bones.size(); ++j)
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column) constants.bones[3 * j + static_cast<size_t>(row)][column] = static_cast<float>(bones[j][column][row]);
  return constants;
}

std::vector<glm::dvec3> FrameOnDevice::take_pose(Device& device, const Avatar& avatar, const Pose& pose) {
  bones_ = bone_transforms(avatar.body.skeleton, avatar.canonical, pose);
  const glm::dvec3 t = arah::root_translation(avatar.body.skeleton, pose);
  for (int axis = 0; axis < 3; ++axis) root_translation_[static_cast<size_t>(axis)] = static_cast<float>(t[axis]);
  const FrameConstants constants = frame_constants(avatar.cube, bones_, t);
  const std::vector<float> rotations = arah::joint_rotations(pose);
  if (!rotations.empty()) device.upload(joint_rotations_.slice().elements(0, rotations.size()), rotations);
  device.upload(constants_.slice(), &constants, sizeof constants);

  // A_b = B_b V_b on the rest vertices.
  std::vector<glm::dvec3> posed = skinned_vertices(avatar.body, rest_to_posed(avatar.body.skeleton, pose));
  glm::dvec3 lower = posed.front(), upper = posed.front();
  for (const glm::dvec3& p : posed) lower = glm::min(lower, p), upper = glm::max(upper, p);
  for (int axis = 0; axis < 3; ++axis) {
    box_.minimum[static_cast<size_t>(axis)] = static_cast<float>(lower[axis] + t[axis] - box_margin);
    box_.maximum[static_cast<size_t>(axis)] = static_cast<float>(upper[axis] + t[axis] + box_margin);
  }
  return posed;
}

void FrameOnDevice::set_pose(Device& device, const Avatar& avatar, const Pose& pose) { take_pose(device, avatar, pose); }

FrameOnDevice::FrameOnDevice(Device& device, const Avatar& avatar, TemplateOnDevice& body, const Pose& pose, const ShellSettings& shell) {
  constants_ = Buffer(device, "frame constants", sizeof(FrameConstants), BufferPlace::device);
  joint_rotations_ = Buffer(device, "rotations of joints", std::max<uint64_t>(4ull * pose_inputs(static_cast<uint32_t>(pose.theta.size())), 256), BufferPlace::device);
  const std::vector<glm::dvec3> posed = take_pose(device, avatar, pose);
  std::vector<std::array<float, 3>> points;
  for (const glm::dvec3& p : posed) points.push_back({static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
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
  shell_grid_ = grid_around(posed, shell.margin, shell.cell, 1 << 20);
  make_shell_distances_ = [grid = shell_grid_, posed, &triangles = avatar.body.triangles, reach = shell.outer + shell.margin] { return template_distances(grid, posed, triangles, reach); };
  device_ = &device;
  // The search tables live on the device now.
  vertices_.grid.vertices.clear(), vertices_.grid.cell_start.clear(), vertices_.grid.cell_seed.clear();
}

BufferSlice FrameOnDevice::shell_distances() {
  if (make_shell_distances_) shell_distances_ = uploaded(*device_, "shell distances", std::exchange(make_shell_distances_, nullptr)());
  return shell_distances_.slice();
}

uint64_t FrameOnDevice::bytes() const {
  const uint64_t distances = make_shell_distances_ ? node_count(shell_grid_) * 4ull : shell_distances_.bytes();
  return constants_.bytes() + joint_rotations_.bytes() + grid_vertices_.bytes() + cell_start_.bytes() + cell_seed_.bytes() + distances + (correspondences_ ? correspondences_->bytes() : 0);
}

}  // namespace arah
