// Writing glTF: arrays into a model's first buffer.
#pragma once

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

}  // namespace arah
