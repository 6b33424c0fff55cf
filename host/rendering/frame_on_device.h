// One pose of the template on the device: what tracing, sampling and skinning read of a frame.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/rendering/correspondence_grid.h"
#include "kernels/rays/generate.h"
#include "kernels/rays/shell_bins.h"
#include "kernels/tracing/nearest_vertex.h"
#include "kernels/vulkan/commands.h"
#include "shaders/shared/frame.h"

namespace arah {

// Skinning influences of the template's vertices: the same for all frames.
class TemplateOnDevice {
 public:
  TemplateOnDevice(Device& device, const BodyTemplate& body);
  BufferSlice joints() { return joints_.slice(); }
  BufferSlice weights() { return weights_.slice(); }

 private:
  Buffer joints_, weights_;
};

// What kernels read of a pose: bones are bone_transforms(), t root_translation().
FrameConstants frame_constants(const CubeNormalization& cube, const std::vector<glm::dmat4>& bones, const glm::dvec3& t);

// Distances of the shell: a grid of `cell` metres over the posed vertices' box grown by `margin`.
struct ShellSettings {
  double cell = 0.025;
  double margin = 0.10;
  double outer = 0.055;  // samples lie where the template is at most this far away, metres …
  double inner = 0.03;   // … and end at the first place deeper inside than this
};

class FrameOnDevice {
 public:
  FrameOnDevice(Device& device, const Avatar& avatar, TemplateOnDevice& body, const Pose& pose, const ShellSettings& shell);

  // Another pose from now on, as far as bone transforms, root translation and box go; posed vertices, shell and correspondences
  // stay those of the pose that the frame was made in, relative to the root. Waits for nothing: not while launches that read it run.
  void set_pose(Device& device, const Avatar& avatar, const Pose& pose);

  BufferSlice constants() { return constants_.slice(); }        // FrameConstants
  BufferSlice joint_rotations() { return joint_rotations_.slice(); }  // float, pose_inputs() of them
  const std::vector<glm::dmat4>& bones() const { return bones_; }     // canonical → posed, without the root translation
  const PosedVertices& vertices() const { return vertices_; }
  const ShellGrid& shell_grid() const { return shell_grid_; }
  // By node of that grid, metres from the posed template. Made when they are first asked for: what is drawn as a mesh needs none.
  BufferSlice shell_distances();
  const std::array<float, 3>& root_translation() const { return root_translation_; }  // metres, world
  const RayBox& box() const { return box_; }  // posed vertices ± 5 cm, world
  // The frame's correspondences, kept; null until they are made.
  CorrespondenceGrid* correspondences() { return correspondences_ ? &*correspondences_ : nullptr; }
  void make_correspondences(Device& device, const ShellSettings& shell) { correspondences_.emplace(device, *this, shell); }
  uint64_t bytes() const;

 private:
  std::vector<glm::dmat4> bones_;
  Buffer constants_, joint_rotations_, grid_vertices_, cell_start_, cell_seed_, shell_distances_;
  PosedVertices vertices_;
  ShellGrid shell_grid_;
  std::function<std::vector<float>()> make_shell_distances_;
  Device* device_ = nullptr;
  std::array<float, 3> root_translation_{};
  RayBox box_;
  std::optional<CorrespondenceGrid> correspondences_;

  // The posed vertices without the root translation.
  std::vector<glm::dvec3> take_pose(Device& device, const Avatar& avatar, const Pose& pose);
};

}  // namespace arah
