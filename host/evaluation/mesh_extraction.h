// Meshes of an avatar's surface, frame by frame, and their colours.
#pragma once

#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "host/rendering/baked_distances.h"
#include "host/rendering/frame_on_device.h"
#include "host/rendering/surface_colors.h"
#include "host/rendering/surface_mesh.h"

namespace arah {

struct MeshSettings {
  double cell = 0.008;            // metres, the edge of the cubes that the surface is cut by, at most (marched_mesh.h)
  double outline = 0;             // metres outside of the surface, where the mesh lies
  double least_part = arah::least_part;  // of the largest connected part's vertices; smaller parts are left out. 1: the largest alone
  std::size_t most_triangles = 0;  // 0: all (mesh_simplification.h)
};

class MeshExtraction {
 public:
  // Throws InputError for an avatar that has no surface.
  MeshExtraction(Device& device, const Avatar& avatar, const MeshSettings& settings);

  // By marching cubes on the device. Of a pose and a row of codes; stays until the next call, and is made anew only where the SDF follows what has changed.
  const SurfaceMesh& mesh(const Pose& pose, std::size_t latent_row);
  // The field's colours at canonical points of the last mesh() (SurfaceColors::at), for its pose and code.
  // Signed distances of canonical points in another frame, metres: whatever the shape of that pose and code. Ends what the last
  // mesh() stood for, except the mesh itself.
  std::vector<double> distances(const Pose& pose, std::size_t latent_row, std::span<const glm::dvec3> points);
  // Whether frames differ in shape beyond skinning.
  bool shape_follows_frames() const;
  // How much farther out than the last mesh's each vertex must lie for the outline that rendering shows where it is seen from the
  // side, metres: a ray that passes a cylinder of radius R at the distance d meets the density e^(−s/b) / 2b at s ≈ d + t² / 2R, in
  // all τ = √(2πRb) e^(−d/b) / 2b, and alpha is ½ where τ is ln 2. So d = b ln(τ₀ / ln 2), with τ₀ the optical depth along the tangent
  // at the vertex that leaves the body soonest: 1 to 3 b. 0 at least; in hollows what a radius of 15 cm gives at most.
  std::vector<double> outlines() const;
  double outline() const { return settings_.outline; }  // metres
  std::vector<glm::vec3> colors(std::span<const glm::vec3> points, std::span<const glm::vec3> normals, std::span<const glm::mat4> transforms);

  // Of the pose and code of the last mesh().
  AvatarNetworks& networks() { return networks_; }
  FrameOnDevice& frame() { return *frame_; }

  // Of the last mesh that was made: metres that having fewer triangles moved it by, and points that the network was asked for.
  double simplification_error() const { return simplification_error_; }
  uint64_t evaluated() const { return evaluated_; }

 private:
  std::vector<double> distances_as_packed(std::span<const glm::dvec3> points);

  Device& device_;
  const Avatar& avatar_;
  Commands commands_;
  AvatarNetworks networks_;
  TemplateOnDevice body_;
  Field field_;  // of distances alone
  MeshSettings settings_;
  BakedDistances baked_;  // rough: cubes of 6 to 12 mm
  double simplification_error_ = 0;
  uint64_t evaluated_ = 0;
  std::optional<FrameOnDevice> frame_;
  std::optional<SurfaceMesh> mesh_;
  std::optional<SurfaceColors> colors_;
  Buffer points_;  // of distances()
  Pose pose_;
  std::size_t row_ = 0;
  bool packed_ = false;  // the networks' weights are of pose_ and row_
  std::optional<std::pair<std::size_t, std::vector<glm::dvec3>>> shapes_frame_;  // else of these
};

}  // namespace arah
