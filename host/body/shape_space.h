// How bodies of one mesh and rig differ in build: displacements of vertices and rest joints, linear in a few numbers β
// (glTF's morph targets, SMPL's shape).
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "host/body/skeleton.h"

namespace arah {

// The most targets that are taken for a body's shape. Files with more hold expressions of a face.
inline constexpr std::size_t kMaxShapes = 64;

// vertex = base vertex + Σ_b β_b · vertex offset_b, and so the rest joints. Nothing is set where the file has no targets.
struct ShapeSpace {
  std::vector<std::string> names;                      // [B]
  std::vector<double> beta;                            // [B] of the body as it is
  std::vector<std::vector<glm::vec3>> vertex_offsets;  // [B][V] metres for β_b = 1, rest pose
  std::vector<std::vector<glm::dvec3>> joint_offsets;  // [B][J] metres
  std::vector<glm::vec3> base_vertices;                // [V] with β = 0
  std::vector<glm::dvec3> base_joints;                 // [J]
  std::string ignored;  // why targets that the file has are not here, in words; empty where all are

  std::size_t size() const { return names.size(); }
  bool moves_joints() const;  // whether any offset of a joint is not 0
};

struct BodyTemplate;

// The body's skeleton in the shape β, its own bit for bit where that is the one it has. Throws as set_shape().
Skeleton skeleton_in_shape(const BodyTemplate& body, const std::vector<double>& beta);

// Gives the body's vertices and rest joints the shape β; where it is 0 they are the base's, bit for bit. Normals stay the
// base's, as in glTF viewers where targets have none of their own; body.glb stays the file that was read. Throws
// std::invalid_argument where β has another size than the body's shape.
void set_shape(BodyTemplate& body, const std::vector<double>& beta);

// The body in another shape for as long as this lives.
class InShape {
 public:
  InShape(BodyTemplate& body, const std::vector<double>& beta);
  ~InShape();
  InShape(const InShape&) = delete;
  InShape& operator=(const InShape&) = delete;

 private:
  BodyTemplate& body_;
  std::vector<double> before_;
};

// Where a file does not say how a target moves the rest joints: a joint moves with the seam between its bone and its
// parent's, by the mean of the displacements of vertices, weighted by w_j · w_parent (the root's by w_root); where no vertex
// belongs to both, with its bone's vertices, weighted by w_j; where the bone has none, as its parent does. [J]
std::vector<glm::dvec3> joint_offsets_from(const BodyTemplate& body, const std::vector<glm::vec3>& vertex_offsets);

}  // namespace arah
