// Writes small ONNX files for tests: protobuf messages of a few fields each, so that no further library is needed.
// Field numbers: onnx/onnx.proto3 of the ONNX standard; wire format: protobuf's encoding (varints, length-delimited fields).
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <vector>

namespace arah::onnx {

inline std::string varint(uint64_t value) {
  std::string bytes;
  for (; value >= 128; value >>= 7) bytes += static_cast<char>((value & 127) | 128);
  return bytes + static_cast<char>(value);
}
inline std::string number(unsigned field, int64_t value) { return varint(field << 3) + varint(static_cast<uint64_t>(value)); }
inline std::string message(unsigned field, const std::string& bytes) { return varint(field << 3 | 2) + varint(bytes.size()) + bytes; }
// Four bytes each, lowest first.
inline std::string raw(const std::vector<float>& values) {
  std::string bytes;
  for (const float value : values)
    for (int shift = 0; shift < 32; shift += 8) bytes += static_cast<char>(std::bit_cast<uint32_t>(value) >> shift);
  return bytes;
}

constexpr int64_t open = -1;  // a dimension that the file leaves open

class Graph {
 public:
  // type: ONNX's element type; 1 is float32.
  void input(const std::string& name, const std::vector<int64_t>& shape, int type = 1) { inputs_ += message(11, value_info(name, shape, type)); }
  void output(const std::string& name, const std::vector<int64_t>& shape) { outputs_ += message(12, value_info(name, shape, 1)); }
  void constant(const std::string& name, const std::vector<int64_t>& shape, const std::vector<float>& values) {
    std::string tensor;
    for (const int64_t size : shape) tensor += number(1, size);
    initializers_ += message(5, tensor + number(2, 1) + message(8, name) + message(9, raw(values)));
  }
  void constant(const std::string& name, const std::vector<int64_t>& values) {
    std::string tensor = number(1, static_cast<int64_t>(values.size())) + number(2, 7) + message(8, name);
    for (const int64_t value : values) tensor += number(7, value);
    initializers_ += message(5, tensor);
  }
  // The same by a node, as some exporters have it.
  void constant_node(const std::string& name, const std::vector<int64_t>& shape, const std::vector<float>& values) {
    std::string tensor;
    for (const int64_t size : shape) tensor += number(1, size);
    tensor += number(2, 1) + message(9, raw(values));
    nodes_ += message(1, message(2, name) + message(3, name) + message(4, "Constant") + message(5, message(1, "value") + message(5, tensor) + number(20, 4)));
  }
  struct Integers {
    std::string name;
    std::vector<int64_t> values;
    bool single = false;  // an attribute of one integer, not a list
  };
  void node(const std::string& operation, const std::vector<std::string>& from, const std::string& to, const std::vector<Integers>& attributes = {}) {
    std::string bytes;
    for (const std::string& name : from) bytes += message(1, name);
    bytes += message(2, to) + message(3, to) + message(4, operation);
    for (const Integers& attribute : attributes) {
      std::string field = message(1, attribute.name);
      for (const int64_t value : attribute.values) field += number(attribute.single ? 3 : 8, value);
      bytes += message(5, field + number(20, attribute.single ? 2 : 7));
    }
    nodes_ += message(1, bytes);
  }
  // The whole file: ModelProto of IR version 7.
  std::string file(int operator_set = 11) const {
    return number(1, 7) + message(2, "test") + message(7, nodes_ + message(2, "graph") + initializers_ + inputs_ + outputs_) + message(8, message(1, "") + number(2, operator_set));
  }

 private:
  static std::string value_info(const std::string& name, const std::vector<int64_t>& shape, int type) {
    std::string dimensions;
    for (const int64_t size : shape) dimensions += message(1, size == open ? message(2, "n" + std::to_string(dimensions.size())) : number(1, size));
    return message(1, name) + message(2, message(1, number(1, type) + message(2, dimensions)));
  }
  std::string nodes_, initializers_, inputs_, outputs_;
};

}  // namespace arah::onnx
