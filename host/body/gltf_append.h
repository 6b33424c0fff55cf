// Writing glTF: arrays into a model's first buffer.
#pragma once

#include <glm/common.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "host/body/gltf.h"

namespace arah {

// Appends an array as a buffer view of its own, aligned to 4 bytes; returns the view's index.
template <typename T>
int append_view(tinygltf::Model* model, const std::vector<T>& values, int target) {
  std::vector<unsigned char>& buffer = model->buffers[0].data;
  buffer.resize((buffer.size() + 3) / 4 * 4);  // glTF: accessors are aligned to their component size
  tinygltf::BufferView view;
  view.buffer = 0;
  view.byteOffset = buffer.size();
  view.byteLength = values.size() * sizeof(T);
  view.target = target;
  const auto* bytes = reinterpret_cast<const unsigned char*>(values.data());
  buffer.insert(buffer.end(), bytes, bytes + view.byteLength);
  model->bufferViews.push_back(view);
  return static_cast<int>(model->bufferViews.size()) - 1;
}

// Appends an array as a buffer view and an accessor of their own; returns the accessor's index. `elements` of `type` are in it.
template <typename T>
int append(tinygltf::Model* model, const std::vector<T>& values, int target, int component_type, int type, std::size_t elements) {
  tinygltf::Accessor accessor;
  accessor.bufferView = append_view(model, values, target);
  accessor.componentType = component_type;
  accessor.type = type;
  accessor.count = elements;
  model->accessors.push_back(accessor);
  return static_cast<int>(model->accessors.size()) - 1;
}

// append() of a vector each for vertices.
inline int append_vectors(tinygltf::Model* model, const std::vector<glm::vec3>& values) {
  return append(model, values, TINYGLTF_TARGET_ARRAY_BUFFER, TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC3, values.size());
}

// append_vectors() of places or displacements, at least one, with the bounds that glTF asks for.
inline int append_positions(tinygltf::Model* model, const std::vector<glm::vec3>& values) {
  const int index = append_vectors(model, values);
  glm::vec3 least = values[0], greatest = values[0];
  for (const glm::vec3& value : values) least = glm::min(least, value), greatest = glm::max(greatest, value);
  tinygltf::Accessor& accessor = model->accessors[static_cast<std::size_t>(index)];
  accessor.minValues = {least.x, least.y, least.z};
  accessor.maxValues = {greatest.x, greatest.y, greatest.z};
  return index;
}

}  // namespace arah
