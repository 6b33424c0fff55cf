// A GLB file taken apart, for tests to change, and put together again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "host/body/body_template.h"

namespace arah {

inline std::string text_of(const std::vector<std::byte>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
inline std::vector<std::byte> bytes_of(const std::string& text) {
  const std::span<const std::byte> bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

inline std::string padded(std::string text, char with) {
  text.resize((text.size() + 3) / 4 * 4, with);
  return text;
}
inline std::string word(std::size_t value) {
  std::string text;
  for (int k = 0; k < 4; ++k) text.push_back(static_cast<char>((value >> (8 * k)) & 255));
  return text;
}

// The JSON and the buffer of a GLB, for tests to change, and back.
struct Parts {
  nlohmann::json head;
  std::string buffer;

  explicit Parts(const BodyTemplate& body) {
    const std::string glb = text_of(body_template_glb(body));
    std::uint32_t size = 0;
    std::memcpy(&size, glb.data() + 12, 4);
    head = nlohmann::json::parse(glb.substr(20, size));
    buffer = glb.substr(28 + size);
  }
  std::string glb() const {
    const std::string text = padded(head.dump(), ' '), data = padded(buffer, '\0');
    const std::string chunks = word(text.size()) + "JSON" + text + word(data.size()) + std::string("BIN\0", 4) + data;
    return "glTF" + word(2) + word(12 + chunks.size()) + chunks;
  }
  // Appends a buffer view; its index.
  template <typename T>
  std::size_t add_view(const std::vector<T>& values) {
    buffer = padded(buffer, '\0');
    head["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", sizeof(T) * values.size()}});
    buffer.append(reinterpret_cast<const char*>(values.data()), sizeof(T) * values.size());
    head["buffers"][0]["byteLength"] = buffer.size();
    return head["bufferViews"].size() - 1;
  }
  // Appends an accessor of floats; its index.
  std::size_t add_floats(const std::vector<float>& values, const std::string& type, std::size_t n) {
    const std::size_t view = add_view(values);
    head["accessors"].push_back({{"bufferView", view}, {"componentType", 5126}, {"type", type}, {"count", n}});
    return head["accessors"].size() - 1;
  }
  // Replaces the accessor of a vertex attribute by floats.
  void set_floats(const std::string& attribute, const std::vector<float>& values, const std::string& type,
                  std::size_t n) {
    primitive()["attributes"][attribute] = add_floats(values, type, n);
  }
  nlohmann::json& primitive() { return head["meshes"][0]["primitives"][0]; }
};

inline BodyTemplate read(const Parts& parts) {
  return read_body_template_bytes(bytes_of(parts.glb()), "figure.glb");
}

}  // namespace arah
