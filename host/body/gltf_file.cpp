#include "host/body/gltf_file.h"

#include <algorithm>
#include <cstring>
#include <glm/gtc/quaternion.hpp>

#include "host/body/json_fields.h"
#include "host/body/mapped_file.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kMostGltfFile = 128'000'000;  // bytes, the buffer included
constexpr std::size_t kMostGltfJson = 64'000'000;
constexpr std::size_t kMostBufferBytes = 128'000'000;  // of all buffers
// tinygltf builds objects of some hundred bytes each, twice while lists grow.
constexpr JsonCost kGltfCost{.list = 2'500, .item = 500, .member = 200, .text = 100, .most = 256'000'000};

// Textures are not needed; without a loader tinygltf refuses files that have any.
bool ignore_image(tinygltf::Image*, int, std::string*, std::string*, int, int, const unsigned char*, int, void*) {
  return true;
}

// Files beside a text file, for its buffers: regular ones in its folder or below, of bounded size. user_data is the folder; null where there
// is none, because a binary file is one piece.
bool is_beside(const std::string& path, void* user_data) {
  if (user_data == nullptr) return false;
  const auto& folder = *static_cast<const std::filesystem::path*>(user_data);
  const std::filesystem::path inside = std::filesystem::path(path).lexically_normal().lexically_relative(folder);
  std::error_code error;
  return !inside.empty() && *inside.begin() != ".." && std::filesystem::is_regular_file(path, error) && std::filesystem::file_size(path, error) <= kMostBufferBytes;
}
bool read_beside(std::vector<unsigned char>* bytes, std::string* error, const std::string& path, void* user_data) {
  return is_beside(path, user_data) && tinygltf::ReadWholeFile(bytes, error, path, nullptr);
}

// Looks at the JSON before tinygltf does, which copies the binary chunk for each buffer that names no file and follows
// extras into any depth. chunk: bytes of the file that buffers may hold.
void check_head(std::string_view text, std::size_t chunk, const std::string& where) {
  if (text.size() > kMostGltfJson) throw InputError(where, "", fmt::format("at most {} bytes of JSON", kMostGltfJson), fmt::format("{}", text.size()));
  check_json_text(text, where, "", kGltfCost);
  const nlohmann::json head = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);  // tinygltf says what is wrong
  if (!head.is_object() || !head.contains("buffers")) return;
  std::size_t bytes = 0;
  for (const nlohmann::json& buffer : json_list(head["buffers"], -1, where, "buffers")) {
    const nlohmann::json& length = json_member(buffer, "byteLength", where, "buffers");
    if (!length.is_number_unsigned() || length.get<std::size_t>() < 1) throw InputError(where, "buffers byteLength", "a whole number of at least 1", json_excerpt(length));
    if (!buffer.contains("uri") && length.get<std::size_t>() > chunk) throw InputError(where, "buffers byteLength", fmt::format("at most {} bytes, as the file has", chunk), json_excerpt(length));
    bytes += std::min(length.get<std::size_t>(), kMostBufferBytes + 1);
    if (bytes > kMostBufferBytes) throw InputError(where, "buffers", fmt::format("at most {} bytes", kMostBufferBytes), "more");
  }
}

}  // namespace

std::vector<std::byte> gltf_bytes(const std::filesystem::path& path) {
  if (!std::filesystem::is_regular_file(path)) throw InputError(path.string(), "", "a glTF file", "none that can be opened");
  const MappedFile file(path, kMostGltfFile);
  const std::span<const std::byte> bytes = std::as_bytes(std::span(file.bytes()));
  return {bytes.begin(), bytes.end()};
}

bool is_binary_gltf(std::span<const std::byte> bytes) {
  return bytes.size() >= 4 && std::memcmp(bytes.data(), "glTF", 4) == 0;
}

tinygltf::Model parse_gltf(std::span<const std::byte> bytes, const std::string& where, const std::filesystem::path& folder) {
  if (bytes.size() > kMostGltfFile) throw InputError(where, "", fmt::format("at most {} bytes", kMostGltfFile), fmt::format("{}", bytes.size()));
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const bool binary = is_binary_gltf(bytes);
  if (binary) {
    std::uint32_t json = 0;
    if (text.size() >= 20) std::memcpy(&json, text.data() + 12, 4);
    if (text.size() < 20 || json > text.size() - 20) {
      throw InputError(where, "", "a glTF 2.0 file", fmt::format("one of {} bytes, cut off in its JSON", text.size()), "Copy it again.");
    }
    check_head(text.substr(20, json), text.size() - 20 - json, where);
  } else {
    if (text.empty()) throw InputError(where, "", "a glTF 2.0 file", "an empty one");
    check_head(text, 0, where);
  }
  tinygltf::TinyGLTF reader;
  reader.SetImageLoader(ignore_image, nullptr);
  std::filesystem::path absolute = folder.empty() ? std::filesystem::path() : std::filesystem::absolute(folder).lexically_normal();
  reader.SetFsCallbacks({is_beside, tinygltf::ExpandFilePath, read_beside, nullptr, folder.empty() ? nullptr : &absolute});
  tinygltf::Model model;
  std::string error, warning;
  const unsigned int size = static_cast<unsigned int>(bytes.size());
  bool read = false;
  try {
    const std::string base = absolute.string();
    read = binary ? reader.LoadBinaryFromMemory(&model, &error, &warning, reinterpret_cast<const unsigned char*>(bytes.data()), size, base)
                  : reader.LoadASCIIFromString(&model, &error, &warning, text.data(), size, base);
  } catch (const std::exception& thrown) {  // fields of types that tinygltf does not expect
    error = thrown.what();
  }
  if (!read) {
    std::replace(error.begin(), error.end(), '\n', ' ');
    throw InputError(where, "", "a glTF 2.0 file", "one that cannot be read: " + error.substr(0, 300));
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
  // Every node has one parent, so whatever cannot be reached from a root lies below itself.
  std::vector<std::size_t> reached;
  for (std::size_t n = 0; n < parents_.size(); ++n) {
    if (parents_[n] == kNoGltfNode) reached.push_back(n);
  }
  std::vector<bool> in_tree(parents_.size(), false);
  for (std::size_t i = 0; i < reached.size(); ++i) {
    in_tree[reached[i]] = true;
    for (int child : model.nodes[reached[i]].children) reached.push_back(static_cast<std::size_t>(child));
  }
  for (std::size_t n = 0; n < parents_.size(); ++n) {
    if (!in_tree[n]) throw InputError(where, fmt::format("node {}", n), "a tree", "a node below itself");
  }
}

glm::dmat4 GltfNodeTree::world(std::size_t node) const {
  glm::dmat4 result(1.0);
  for (std::size_t at = node; at != kNoGltfNode; at = parents_[at]) result = local_transform(model_.nodes[at]) * result;
  return result;
}

}  // namespace arah
