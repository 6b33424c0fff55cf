#include "host/evaluation/onnx_model.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <optional>

namespace arah {
namespace {

// Field numbers of ModelProto, GraphProto, ValueInfoProto, TypeProto, TypeProto.Tensor, TensorShapeProto and its
// Dimension, TensorProto, NodeProto.
constexpr uint32_t kModelGraph = 7;
constexpr uint32_t kGraphNode = 1, kGraphInitializer = 5, kGraphInput = 11, kGraphOutput = 12, kGraphValueInfo = 13;
constexpr uint32_t kValueName = 1, kValueType = 2;
constexpr uint32_t kTypeTensor = 1;
constexpr uint32_t kTensorElement = 1, kTensorShape = 2;
constexpr uint32_t kShapeDimension = 1, kDimensionSize = 1;
constexpr uint32_t kConstantName = 8;
constexpr uint32_t kNodeInput = 1, kNodeOutput = 2, kNodeName = 3, kNodeOperation = 4;

enum WireType : uint32_t { varint_wire = 0, eight_bytes_wire = 1, counted_wire = 2, four_bytes_wire = 5 };

// The fields of one message, one after the other.
class MessageFields {
 public:
  explicit MessageFields(std::string_view message) : message_(message) {}

  // False at the end.
  bool next() {
    if (at_ == message_.size()) return false;
    const std::size_t begin = at_;
    const uint64_t tag = read_varint();
    field = static_cast<uint32_t>(tag >> 3);
    type = static_cast<uint32_t>(tag & 7);
    number = 0;
    content = {};
    if (field == 0) throw NotOnnx("is no protobuf message");
    if (type == varint_wire) number = read_varint();
    else if (type == eight_bytes_wire) content = take(8);
    else if (type == four_bytes_wire) content = take(4);
    else if (type == counted_wire) content = take(read_varint());
    else throw NotOnnx("is no protobuf message");
    whole = message_.substr(begin, at_ - begin);
    return true;
  }
  bool is(uint32_t wanted, uint32_t wanted_type = counted_wire) const { return field == wanted && type == wanted_type; }

  uint32_t field = 0, type = 0;
  uint64_t number = 0;       // of a varint
  std::string_view content;  // of the other types
  std::string_view whole;    // the field with its tag

 private:
  uint64_t read_varint() {
    uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      const auto byte = static_cast<unsigned char>(take(1)[0]);
      value |= static_cast<uint64_t>(byte & 127) << shift;
      if (byte < 128) return value;
    }
    throw NotOnnx("is no protobuf message");
  }
  std::string_view take(uint64_t bytes) {
    if (bytes > message_.size() - at_) throw NotOnnx("is no protobuf message, or one that is cut short");
    at_ += bytes;
    return message_.substr(at_ - bytes, bytes);
  }

  std::string_view message_;
  std::size_t at_ = 0;
};

std::string encoded_varint(uint64_t value) {
  std::string bytes;
  for (; value >= 128; value >>= 7) bytes += static_cast<char>((value & 127) | 128);
  return bytes + static_cast<char>(value);
}
std::string encoded_number(uint32_t field, int64_t value) { return encoded_varint(field << 3 | varint_wire) + encoded_varint(static_cast<uint64_t>(value)); }
std::string encoded_message(uint32_t field, std::string_view content) { return encoded_varint(field << 3 | counted_wire) + encoded_varint(content.size()) + std::string(content); }

// The last field of this number, as protobuf has it for a field that is not repeated.
std::optional<std::string_view> part(std::string_view message, uint32_t field) {
  std::optional<std::string_view> found;
  for (MessageFields fields(message); fields.next();)
    if (fields.is(field)) found = fields.content;
  return found;
}

std::string_view graph_of(std::string_view file) {
  const std::optional<std::string_view> graph = part(file, kModelGraph);
  if (!graph) throw NotOnnx("holds no graph");
  return *graph;
}

OnnxValue read_value(std::string_view message) {
  OnnxValue value;
  value.name = part(message, kValueName).value_or("");
  const std::optional<std::string_view> type = part(message, kValueType);
  const std::optional<std::string_view> tensor = type ? part(*type, kTypeTensor) : std::nullopt;
  if (!tensor) return value;
  for (MessageFields fields(*tensor); fields.next();) {
    if (fields.is(kTensorElement, varint_wire)) value.element_type = static_cast<int>(fields.number);
    if (!fields.is(kTensorShape)) continue;
    for (MessageFields dimensions(fields.content); dimensions.next();) {
      if (!dimensions.is(kShapeDimension)) continue;
      int64_t size = -1;
      for (MessageFields dimension(dimensions.content); dimension.next();)
        if (dimension.is(kDimensionSize, varint_wire) && dimension.number > 0) size = static_cast<int64_t>(dimension.number);
      value.shape.push_back(size);
    }
  }
  return value;
}

// A constant is an initializer, or what a node "Constant" puts out.
struct Constant {
  uint32_t field = 0;        // of the graph: kGraphInitializer or kGraphNode
  std::string_view message;
};

std::map<std::string_view, Constant> constants_of(std::string_view graph) {
  std::map<std::string_view, Constant> constants;
  for (MessageFields fields(graph); fields.next();) {
    if (fields.is(kGraphInitializer)) constants[part(fields.content, kConstantName).value_or("")] = {kGraphInitializer, fields.content};
    if (fields.is(kGraphNode) && part(fields.content, kNodeOperation) == "Constant") constants[part(fields.content, kNodeOutput).value_or("")] = {kGraphNode, fields.content};
  }
  return constants;
}

// As a field of the graph.
std::string copy_of(const Constant& constant, const std::string& name) {
  const bool node = constant.field == kGraphNode;
  std::string message;
  for (MessageFields fields(constant.message); fields.next();)
    if (node ? !fields.is(kNodeOutput) && !fields.is(kNodeName) : !fields.is(kConstantName)) message += fields.whole;
  message += node ? encoded_message(kNodeOutput, name) + encoded_message(kNodeName, name) : encoded_message(kConstantName, name);
  return encoded_message(constant.field, message);
}

// The node as a field of the graph; where it does arithmetic, after copies of the constants that it reads.
std::string with_own_constants(std::string_view node, const std::map<std::string_view, Constant>& constants, int& copies) {
  const std::string_view operation = part(node, kNodeOperation).value_or("");
  if (operation != "Add" && operation != "Sub" && operation != "Mul" && operation != "Div") return encoded_message(kGraphNode, node);
  std::string before, message;
  for (MessageFields fields(node); fields.next();) {
    const auto constant = fields.is(kNodeInput) ? constants.find(fields.content) : constants.end();
    if (constant == constants.end()) {
      message += fields.whole;
      continue;
    }
    const std::string name = fmt::format("{}, copy {}", fields.content, ++copies);
    before += copy_of(constant->second, name);
    message += encoded_message(kNodeInput, name);
  }
  return before + encoded_message(kGraphNode, message);
}

}  // namespace

OnnxSignature onnx_signature(std::string_view file) {
  OnnxSignature signature;
  std::vector<std::string_view> constants;
  bool nodes = false;
  for (MessageFields fields(graph_of(file)); fields.next();) {
    nodes |= fields.is(kGraphNode);
    if (fields.is(kGraphInitializer)) constants.push_back(part(fields.content, kConstantName).value_or(""));
    if (fields.is(kGraphInput)) signature.inputs.push_back(read_value(fields.content));
    if (fields.is(kGraphOutput)) signature.outputs.push_back(read_value(fields.content));
  }
  if (!nodes) throw NotOnnx("holds a graph without nodes");
  std::erase_if(signature.inputs, [&](const OnnxValue& value) { return std::find(constants.begin(), constants.end(), value.name) != constants.end(); });
  return signature;
}

std::string for_opencv(std::string_view file, const std::vector<int64_t>& shape) {
  const OnnxSignature signature = onnx_signature(file);
  std::string dimensions;
  for (const int64_t size : shape) dimensions += encoded_message(kShapeDimension, encoded_number(kDimensionSize, size));
  const std::string tensor = encoded_number(kTensorElement, kOnnxFloat32) + encoded_message(kTensorShape, dimensions);
  const std::map<std::string_view, Constant> constants = constants_of(graph_of(file));
  std::string graph;
  graph.reserve(file.size() + 4096);
  int copies = 0;
  for (MessageFields fields(graph_of(file)); fields.next();) {
    if (fields.is(kGraphValueInfo)) continue;
    if (fields.is(kGraphNode)) {
      graph += with_own_constants(fields.content, constants, copies);
      continue;
    }
    const std::string_view name = fields.is(kGraphInput) ? part(fields.content, kValueName).value_or("") : "";
    const bool changes = fields.is(kGraphInput) && std::any_of(signature.inputs.begin(), signature.inputs.end(), [&](const OnnxValue& value) { return value.name == name; });
    if (changes) graph += encoded_message(kGraphInput, encoded_message(kValueName, name) + encoded_message(kValueType, encoded_message(kTypeTensor, tensor)));
    else graph += fields.whole;
  }
  std::string model;
  for (MessageFields fields(file); fields.next();)
    if (!fields.is(kModelGraph)) model += fields.whole;
  return model + encoded_message(kModelGraph, graph);
}

std::string describe(const std::vector<OnnxValue>& values) {
  std::string text;
  for (const OnnxValue& value : values) {
    std::vector<std::string> shape;
    for (const int64_t size : value.shape) shape.push_back(size < 0 ? "?" : std::to_string(size));
    text += fmt::format("{}'{}' {} [{}]", text.empty() ? "" : ", ", value.name, value.element_type == kOnnxFloat32 ? "float32" : fmt::format("of type {}", value.element_type), fmt::join(shape, ", "));
  }
  return text.empty() ? "none" : text;
}

}  // namespace arah
