// What an ONNX file says about its inputs and outputs, read from its protobuf messages, and the same file as OpenCV's importer,
// which runs the network, takes it right. Source: onnx.proto3 of the ONNX standard (field numbers), protobuf's wire format.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace arah {

// Bytes that are no ONNX model; what() continues "found a file that …".
class NotOnnx : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct OnnxValue {
  std::string name;
  int element_type = 0;        // TensorProto.DataType; 0: not stated, or no tensor
  std::vector<int64_t> shape;  // -1: left open
};

struct OnnxSignature {
  std::vector<OnnxValue> inputs;  // without those that have a constant of their name
  std::vector<OnnxValue> outputs;
};

inline constexpr int kOnnxFloat32 = 1;  // TensorProto.DataType.FLOAT

// Throws NotOnnx for a text, a file cut short, or a message without a graph.
OnnxSignature onnx_signature(std::string_view file);

// The same network for OpenCV 4.6, with float32 inputs of `shape`. Throws NotOnnx likewise.
// - Each input is declared with that shape: the importer fixes what follows from it, a sum over channels for instance is
//   reshaped to the declared size, and fails where that is open. Noted shapes in between go.
// - Each Add, Sub, Mul and Div has constants of its own: the importer turns a - c into a + (-c) and a / c into a * (1 / c) in
//   the constant's own memory, so that the second user of one gets it negated twice or inverted twice. The authors' network shares
//   its shift and scale between the two pictures: the importer alone gives a wrong number and says nothing.
std::string for_opencv(std::string_view file, const std::vector<int64_t>& shape);

// "'in0' float32 [?, 3, ?, ?], 'in1' …"; "none".
std::string describe(const std::vector<OnnxValue>& values);

}  // namespace arah
