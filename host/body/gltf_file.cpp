#include "host/body/gltf_file.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <glm/gtc/quaternion.hpp>
#include <iterator>

#include "host/input_error.h"

namespace arah {
namespace {

// Textures are not needed; without a loader tinygltf refuses files that have any.
bool ignore_image(tinygltf::Image*, int, std::string*, std::string*, int, int, const unsigned char*, int, void*) {
  return true;
}

}  // namespace

std::vector<std::byte> gltf_bytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || std::filesystem::is_directory(path)) {
    throw InputError(path.string(), "", "a glTF file", "none that can be opened");
  }
  const std::vector<char> content((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  const std::span<const std::byte> bytes = std::as_bytes(std::span(content));
  return {bytes.begin(), bytes.end()};
}

bool is_binary_gltf(std::span<const std::byte> bytes) {
  return bytes.size() >= 4 && std::memcmp(bytes.data(), "glTF", 4) == 0;
}

tinygltf::Model parse_gltf(std::span<const std::byte> bytes, const std::string& where, const std::string& folder) {
  if (bytes.size() > std::numeric_limits<unsigned int>::max()) {
    throw InputError(where, "", "less than 4 GiB", fmt::format("{} bytes", bytes.size()));
  }
  tinygltf::TinyGLTF reader;
  reader.SetImageLoader(ignore_image, nullptr);
  tinygltf::Model model;
  std::string error, warning;
  const unsigned int size = static_cast<unsigned int>(bytes.size());
  const bool read =
      is_binary_gltf(bytes) ? reader.LoadBinaryFromMemory(&model, &error, &warning,
                                           reinterpret_cast<const unsigned char*>(bytes.data()), size, folder)
             : reader.LoadASCIIFromString(&model, &error, &warning, reinterpret_cast<const char*>(bytes.data()), size,
                                          folder);
  if (!read) {
    std::replace(error.begin(), error.end(), '\n', ' ');
    throw InputError(where, "", "a glTF 2.0 file",
                     bytes.empty() ? "an empty one" : "one that cannot be read: " + error);
  }
  return model;
}

glm::dmat4 local_transform(const tinygltf::Node& node) {
  glm::dmat4 result(1.0);
  if (node.matrix.size() == 16) {
    for (int c = 0; c < 4; ++c) {
      for (int r = 0; r < 4; ++r) result[c][r] = node.matrix[static_cast<std::size_t>(4 * c + r)];
    }
    return result;
  }
  if (node.rotation.size() == 4) {
    result = glm::dmat4(glm::mat3_cast(
        glm::normalize(glm::dquat(node.rotation[3], node.rotation[0], node.rotation[1], node.rotation[2]))));
  }
  for (int c = 0; node.scale.size() == 3 && c < 3; ++c) result[c] *= node.scale[static_cast<std::size_t>(c)];
  if (node.translation.size() == 3) {
    result[3] = glm::dvec4(node.translation[0], node.translation[1], node.translation[2], 1.0);
  }
  return result;
}

GltfNodeTree::GltfNodeTree(const tinygltf::Model& model, const std::string& where)
    : model_(model), parents_(model.nodes.size(), kNoGltfNode) {
  for (std::size_t n = 0; n < model.nodes.size(); ++n) {
    for (int child : model.nodes[n].children) {
      if (child < 0 || static_cast<std::size_t>(child) >= parents_.size() ||
          parents_[static_cast<std::size_t>(child)] != kNoGltfNode) {
        throw InputError(where, fmt::format("node {}", n), "children that are nodes with one parent each",
                         fmt::format("child {}", child));
      }
      parents_[static_cast<std::size_t>(child)] = n;
    }
  }
  for (std::size_t n = 0; n < parents_.size(); ++n) {
    std::size_t steps = 0;
    for (std::size_t at = n; at != kNoGltfNode; at = parents_[at]) {
      if (++steps > parents_.size()) {
        throw InputError(where, fmt::format("node {}", n), "a tree", "a node below itself");
      }
    }
  }
}

glm::dmat4 GltfNodeTree::world(std::size_t node) const {
  glm::dmat4 result(1.0);
  for (std::size_t at = node; at != kNoGltfNode; at = parents_[at]) result = local_transform(model_.nodes[at]) * result;
  return result;
}

}  // namespace arah
