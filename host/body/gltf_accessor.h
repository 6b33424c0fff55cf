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
  // `type` is what each element must be (TINYGLTF_TYPE_VEC3, …). sparse: how many elements sparse data must have, which may
  // state none at all; 0: such data is refused. Throws InputError naming `where` and `field`.
  GltfAccessor(const tinygltf::Model& model, int index, int type, const std::string& where, const std::string& field,
               std::size_t sparse = 0) {
    auto refuse = [&](const std::string& expected, const std::string& found) {
      throw InputError(where, field, expected, found);
    };
    if (index < 0 || static_cast<std::size_t>(index) >= model.accessors.size()) {
      refuse(fmt::format("one of {} accessors", model.accessors.size()), fmt::format("accessor {}", index));
    }
    const tinygltf::Accessor& accessor = model.accessors[static_cast<std::size_t>(index)];
    if (accessor.sparse.isSparse && sparse == 0) refuse("dense data", "a sparse accessor");
    if (accessor.type != type) {
      refuse(fmt::format("elements of {} numbers", tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type))),
             fmt::format("accessor type {}", accessor.type));
    }
    const int component_size = tinygltf::GetComponentSizeInBytes(static_cast<std::uint32_t>(accessor.componentType));
    const int components = tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type));
    if (component_size <= 0 || components <= 0) refuse("a known number type", std::to_string(accessor.componentType));
    component_size_ = static_cast<std::size_t>(component_size);
    component_type_ = accessor.componentType;
    normalized_ = accessor.normalized;
    count_ = accessor.count;
    const std::size_t element = component_size_ * static_cast<std::size_t>(components);
    // The place of `count` elements of `size` bytes that a view holds from `offset` on; `stride` is set.
    auto elements = [&](int view_index, std::size_t offset, std::size_t count, std::size_t size, std::size_t& stride) {
      if (view_index < 0 || static_cast<std::size_t>(view_index) >= model.bufferViews.size()) {
        refuse("data", "an accessor without a buffer view (compressed?)");
      }
      const tinygltf::BufferView& view = model.bufferViews[static_cast<std::size_t>(view_index)];
      if (view.buffer < 0 || static_cast<std::size_t>(view.buffer) >= model.buffers.size()) {
        refuse(fmt::format("one of {} buffers", model.buffers.size()), fmt::format("buffer {}", view.buffer));
      }
      const std::vector<unsigned char>& buffer = model.buffers[static_cast<std::size_t>(view.buffer)].data;
      stride = view.byteStride == 0 ? size : view.byteStride;
      // Each term is compared with what is left, so that no sum can wrap around.
      const bool view_fits = view.byteOffset <= buffer.size() && view.byteLength <= buffer.size() - view.byteOffset;
      const bool start_fits = view_fits && offset <= view.byteLength;
      const std::size_t left = start_fits ? view.byteLength - offset : 0;
      if (!start_fits || (count > 0 && (left < size || count - 1 > (left - size) / stride))) {
        refuse(fmt::format("{} elements of {} bytes", count, size),
               fmt::format("a buffer of {} bytes that ends before them", buffer.size()));
      }
      return buffer.data() + view.byteOffset + offset;
    };
    if (!accessor.sparse.isSparse) {
      data_ = elements(accessor.bufferView, accessor.byteOffset, count_, element, stride_);
      return;
    }
    if (count_ != sparse) refuse(fmt::format("{} elements", sparse), fmt::format("{}", count_));
    const auto& some = accessor.sparse;
    if (some.count < 0 || static_cast<std::size_t>(some.count) > count_ || some.indices.byteOffset < 0 || some.values.byteOffset < 0) {
      refuse(fmt::format("0 to {} sparse elements", count_), fmt::format("{} from {} and {} on", some.count, some.indices.byteOffset, some.values.byteOffset));
    }
    const auto stated = static_cast<std::size_t>(some.count);
    whole_.assign(count_ * element, 0);
    if (accessor.bufferView >= 0) {
      const unsigned char* dense = elements(accessor.bufferView, accessor.byteOffset, count_, element, stride_);
      for (std::size_t i = 0; i < count_; ++i) std::memcpy(whole_.data() + i * element, dense + i * stride_, element);
    }
    const int index_type = some.indices.componentType;
    const std::size_t index_size = index_type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE    ? 1
                                   : index_type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ? 2
                                   : index_type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT   ? 4
                                                                                          : 0;
    if (index_size == 0) refuse("unsigned sparse indices", fmt::format("number type {}", index_type));
    std::size_t index_stride = 0, value_stride = 0;
    const unsigned char* indices = elements(some.indices.bufferView, static_cast<std::size_t>(some.indices.byteOffset), stated, index_size, index_stride);
    const unsigned char* values = elements(some.values.bufferView, static_cast<std::size_t>(some.values.byteOffset), stated, element, value_stride);
    for (std::size_t i = 0; i < stated; ++i) {
      const unsigned char* at = indices + i * index_stride;
      const std::size_t place = index_size == 1 ? load<std::uint8_t>(at) : index_size == 2 ? load<std::uint16_t>(at) : load<std::uint32_t>(at);
      if (place >= count_) refuse(fmt::format("sparse elements below {}", count_), fmt::format("element {}", place));
      std::memcpy(whole_.data() + place * element, values + i * value_stride, element);
    }
    stride_ = element;
    data_ = whole_.data();
  }
  GltfAccessor(const GltfAccessor&) = delete;
  GltfAccessor& operator=(const GltfAccessor&) = delete;

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

  std::vector<unsigned char> whole_;  // of a sparse accessor
  const unsigned char* data_ = nullptr;
  std::size_t stride_ = 0, count_ = 0, component_size_ = 0;
  int component_type_ = 0;
  bool normalized_ = false;
};

}  // namespace arah
