// Reading glTF accessors without trusting them.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "host/body/gltf.h"
#include "host/input_error.h"

namespace arah {

// The elements of one accessor, checked to lie within their buffer.
class GltfAccessor {
 public:
  // `type` is what each element must be (TINYGLTF_TYPE_VEC3, …). Throws InputError naming `where` and `field`.
  GltfAccessor(const tinygltf::Model& model, int index, int type, const std::string& where, const std::string& field) {
    auto refuse = [&](const std::string& expected, const std::string& found) {
      throw InputError(where, field, expected, found);
    };
    if (index < 0 || static_cast<std::size_t>(index) >= model.accessors.size()) {
      refuse(fmt::format("one of {} accessors", model.accessors.size()), fmt::format("accessor {}", index));
    }
    const tinygltf::Accessor& accessor = model.accessors[static_cast<std::size_t>(index)];
    if (accessor.sparse.isSparse) refuse("dense data", "a sparse accessor");
    if (accessor.type != type) {
      refuse(fmt::format("elements of {} numbers", tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type))),
             fmt::format("accessor type {}", accessor.type));
    }
    if (accessor.bufferView < 0 || static_cast<std::size_t>(accessor.bufferView) >= model.bufferViews.size()) {
      refuse("data", "an accessor without a buffer view (compressed?)");
    }
    const tinygltf::BufferView& view = model.bufferViews[static_cast<std::size_t>(accessor.bufferView)];
    if (view.buffer < 0 || static_cast<std::size_t>(view.buffer) >= model.buffers.size()) {
      refuse(fmt::format("one of {} buffers", model.buffers.size()), fmt::format("buffer {}", view.buffer));
    }
    const std::vector<unsigned char>& buffer = model.buffers[static_cast<std::size_t>(view.buffer)].data;
    const int component_size = tinygltf::GetComponentSizeInBytes(static_cast<std::uint32_t>(accessor.componentType));
    const int components = tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type));
    if (component_size <= 0 || components <= 0) refuse("a known number type", std::to_string(accessor.componentType));
    component_size_ = static_cast<std::size_t>(component_size);
    component_type_ = accessor.componentType;
    normalized_ = accessor.normalized;
    count_ = accessor.count;
    const std::size_t element = component_size_ * static_cast<std::size_t>(components);
    stride_ = view.byteStride == 0 ? element : view.byteStride;
    // Each term is compared with what is left, so that no sum can wrap around.
    const bool view_fits = view.byteOffset <= buffer.size() && view.byteLength <= buffer.size() - view.byteOffset;
    const bool start_fits = view_fits && accessor.byteOffset <= view.byteLength;
    const std::size_t left = start_fits ? view.byteLength - accessor.byteOffset : 0;
    if (!start_fits || (count_ > 0 && (left < element || count_ - 1 > (left - element) / stride_))) {
      refuse(fmt::format("{} elements of {} bytes", count_, element),
             fmt::format("a buffer of {} bytes that ends before them", buffer.size()));
    }
    data_ = buffer.data() + view.byteOffset + accessor.byteOffset;
  }

  std::size_t count() const { return count_; }
  int component_type() const { return component_type_; }

  // One number as stored; normalised integers become fractions of their greatest value.
  double value(std::size_t element, std::size_t component) const {
    const unsigned char* at = data_ + element * stride_ + component * component_size_;
    switch (component_type_) {
      case TINYGLTF_COMPONENT_TYPE_BYTE:
        return scaled(load<std::int8_t>(at), 127.0);
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return scaled(load<std::uint8_t>(at), 255.0);
      case TINYGLTF_COMPONENT_TYPE_SHORT:
        return scaled(load<std::int16_t>(at), 32767.0);
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return scaled(load<std::uint16_t>(at), 65535.0);
      case TINYGLTF_COMPONENT_TYPE_INT:
        return static_cast<double>(load<std::int32_t>(at));
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
        return static_cast<double>(load<std::uint32_t>(at));
      case TINYGLTF_COMPONENT_TYPE_FLOAT:
        return static_cast<double>(load<float>(at));
      default:
        return load<double>(at);
    }
  }

 private:
  template <typename T>
  static T load(const unsigned char* at) {
    T value;
    std::memcpy(&value, at, sizeof(T));
    return value;
  }
  double scaled(int value, double greatest) const { return normalized_ ? value / greatest : value; }

  const unsigned char* data_ = nullptr;
  std::size_t stride_ = 0, count_ = 0, component_size_ = 0;
  int component_type_ = 0;
  bool normalized_ = false;
};

}  // namespace arah
