// A glTF file's model and its nodes, for readers that do not trust them.
#pragma once

#include <cstddef>
#include <filesystem>
#include <glm/mat4x4.hpp>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "host/body/gltf.h"

namespace arah {

// The file's bytes. Throws InputError where it cannot be opened or has more than 128 MB.
std::vector<std::byte> gltf_bytes(const std::filesystem::path& path);

// Whether they begin as a .glb does.
bool is_binary_gltf(std::span<const std::byte> bytes);

// The model, without pictures. folder: of a text file, where or below which its buffers lie; empty: they are in the file. Throws InputError
// naming `where`: not glTF 2.0, damaged, JSON that is deep or would take much memory, buffers of more than 128 MB together.
tinygltf::Model parse_gltf(std::span<const std::byte> bytes, const std::string& where, const std::filesystem::path& folder);

inline constexpr std::size_t kNoGltfNode = std::numeric_limits<std::size_t>::max();

// A node's own transform at rest, of its matrix or of translation, rotation and scale.
glm::dmat4 local_transform(const tinygltf::Node& node);

// The scene's nodes with their parents, checked to be a forest; InputError naming `where` if they are not.
class GltfNodeTree {
 public:
  GltfNodeTree(const tinygltf::Model& model, const std::string& where);

  std::size_t parent(std::size_t node) const { return parents_[node]; }  // kNoGltfNode: none

  glm::dmat4 world(std::size_t node) const;

 private:
  const tinygltf::Model& model_;
  std::vector<std::size_t> parents_;
};

}  // namespace arah
