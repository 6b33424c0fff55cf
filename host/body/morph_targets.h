// Reading a body's shape from the morph targets of a glTF file.
#pragma once

#include <glm/mat3x3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "host/body/body_template.h"
#include "host/body/gltf.h"

namespace arah {

// Takes the file's meshes one after the other, as their vertices are appended to a template. A target's number and the
// weight of its node, else of its mesh, are β. Targets of the same name and weight in several meshes (a body's and its
// eyes') are one. extras.targetNames names them. A target without POSITION says nothing of the shape and is left out.
// Rest joints: the mesh's extras.joint_shapedirs, metres, [target][joint of the skin][xyz], else joint_offsets_from().
// All throw InputError: targets, weights or vertices of different counts, displacements that are not finite.
class MorphTargets {
 public:
  // linear: of the transform from the mesh's space to the world at rest. joint_of_slot: the skin's joint → the template's.
  MorphTargets(const tinygltf::Model& model, const glm::dmat3& linear, std::vector<int> joint_of_slot, const std::string& where)
      : model_(model), linear_(linear), joint_of_slot_(std::move(joint_of_slot)), where_(where) {}

  void begin_mesh(const tinygltf::Node& node, const tinygltf::Mesh& mesh);
  // Of the mesh begun last; its vertices are the template's from `first` on.
  void add_primitive(const tinygltf::Primitive& primitive, const std::string& field, std::size_t first, std::size_t vertices);
  // Gives the template its shape space, once all its vertices are there, and the shape that the file states.
  void finish(BodyTemplate* body);

 private:
  struct Target {
    std::string name;
    double weight = 0.0;
    bool displaces = false;  // by POSITION, in any primitive
    std::vector<glm::vec3> offsets;  // up to the last vertex that it displaces
    std::optional<std::vector<glm::dvec3>> joints;
  };

  std::optional<std::vector<glm::dvec3>> stated_joints(const tinygltf::Mesh& mesh, std::size_t target) const;

  const tinygltf::Model& model_;
  glm::dmat3 linear_;
  std::vector<int> joint_of_slot_;
  const std::string& where_;
  std::vector<Target> targets_;
  std::vector<std::size_t> of_mesh_;  // its targets' places in targets_
  std::size_t displacements_ = 0;     // of all targets
  std::size_t most_ = 0;              // targets of a mesh that has too many; 0: none has
};

}  // namespace arah
