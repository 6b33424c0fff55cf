#include "kernels/linear/dense_network.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>

namespace arah {

DenseShape DenseShape::chain(LayerKind kind, const std::vector<uint32_t>& widths, Activation hidden, Activation last, uint32_t constant_inputs) {
  DenseShape shape;
  for (size_t i = 0; i + 1 < widths.size(); ++i) {
    LayerShape layer;
    layer.kind = kind;
    layer.inputs = widths[i];
    layer.outputs = widths[i + 1];
    if (i == 0) layer.constant_first = widths[0] - constant_inputs, layer.constant_count = constant_inputs;
    shape.layers.push_back(layer);
    shape.activations.push_back(i + 2 == widths.size() ? last : hidden);
  }
  return shape;
}

DenseShape DenseShape::with_skip(int at) const {
  if (skip >= 0 || at < 1 || static_cast<size_t>(at) >= layers.size())
    throw std::invalid_argument(fmt::format("a network of {} layers with skip {} takes no skip before layer {}", layers.size(), skip, at));
  DenseShape shape = *this;
  const LayerShape& first = layers.at(0);
  LayerShape& layer = shape.layers.at(static_cast<size_t>(at));
  shape.skip = at;
  layer.inputs += first.inputs;
  layer.constant_first = first.constant_first;
  layer.constant_count = first.constant_count;
  const uint32_t streamed = first.inputs - first.constant_count;
  layer.gap_first = streamed;
  layer.gap_count = padded_channels(streamed) - streamed;
  return shape;
}

DenseTape::DenseTape(Device& device, const std::string& name, const DenseShape& shape, uint32_t capacity, bool with_gradients, Element hidden)
    : capacity_(padded_points(capacity)), shape_(shape) {
  if (with_gradients && hidden != Element::float32) throw std::invalid_argument(fmt::format("tape '{}': gradients need values in float32", name));
  auto make = [&](const std::string& what, uint32_t channels, Element element = Element::float32) {
    buffers_.emplace_back(device, name + " " + what, uint64_t(capacity_) * channels * bytes_of(element), BufferPlace::device);
    return Matrix{{}, channels, 0, element};
  };
  // Slices point at their Buffer, so the buffers are all made before the first slice is taken.
  buffers_.reserve(shape.layers.size() * 2 + 6);
  std::vector<std::pair<Matrix*, Matrix>> wanted;  // the second one without its slice
  values_.resize(shape.layers.size() + 1);
  adjoints_.resize(shape.layers.size());
  const uint32_t input = shape.padded_input();
  if (shape.skip < 0) wanted.emplace_back(&values_[0], make("input", input));
  // Without a way back, layers take turns in two matrices.
  Matrix turns[2];
  std::array<uint32_t, 2> turn_channels{};
  const auto takes_turns = [&](size_t l) { return !with_gradients && l + 1 < shape.layers.size() && static_cast<int>(l) + 1 != shape.skip; };
  for (size_t l = 0; l < shape.layers.size(); ++l)
    if (takes_turns(l)) turn_channels[l % 2] = std::max(turn_channels[l % 2], shape.layers[l].padded_outputs());
  for (size_t turn = 0; turn < 2; ++turn)
    if (turn_channels[turn]) wanted.emplace_back(&turns[turn], make("turn " + std::to_string(turn), turn_channels[turn], hidden));
  for (size_t l = 0; l < shape.layers.size(); ++l) {
    if (takes_turns(l)) continue;
    if (static_cast<int>(l) + 1 == shape.skip) wanted.emplace_back(&joined_, make("joined input", shape.layers[l + 1].padded_inputs()));
    else wanted.emplace_back(&values_[l + 1], make("layer " + std::to_string(l), shape.layers[l].padded_outputs()));
  }
  if (with_gradients) {
    for (size_t l = 0; l < shape.layers.size(); ++l) wanted.emplace_back(&adjoints_[l], make("adjoint " + std::to_string(l), shape.layers[l].padded_outputs()));
    wanted.emplace_back(&output_gradient_, make("output gradient", shape.layers.back().padded_outputs()));
    wanted.emplace_back(&input_gradient_, make("input gradient", input));
    if (shape.skip >= 0) wanted.emplace_back(&joined_gradient_, make("joined input gradient", shape.layers[static_cast<size_t>(shape.skip)].padded_inputs()));
  }
  for (size_t i = 0; i < wanted.size(); ++i) {
    *wanted[i].first = wanted[i].second;
    wanted[i].first->slice = buffers_[i].slice();
  }
  for (size_t l = 0; l < shape.layers.size(); ++l)
    if (takes_turns(l)) values_[l + 1] = {turns[l % 2].slice, shape.layers[l].padded_outputs(), 0, hidden};
  if (shape.skip >= 0) {
    // The input lives in the joined matrix itself; the hidden part follows it there.
    values_[0] = joined_;
    values_[static_cast<size_t>(shape.skip)] = joined_.columns_from(input);
  }
  Commands zero(device);
  for (Buffer& buffer : buffers_) zero.fill(buffer.slice(), 0);
  zero.submit_and_wait();
}

Matrix DenseTape::input() { return values_[0]; }
Matrix DenseTape::output() { return values_.back(); }
Matrix DenseTape::output_gradient() { return output_gradient_; }
Matrix DenseTape::input_gradient() { return input_gradient_; }

DenseNetwork::DenseNetwork(Device& device, const std::string& name, const DenseShape& shape, const std::vector<LayerTensors>& parameters,
                           const std::vector<LayerTensors>& gradients)
    : name_(name), shape_(shape) {
  if (parameters.size() != shape.layers.size() || gradients.size() != shape.layers.size())
    throw std::invalid_argument(fmt::format("network '{}': {} layers, tensors for {}", name, shape.layers.size(), parameters.size()));
  if (std::find(shape.activations.begin(), shape.activations.end(), Activation::sine) != shape.activations.end())
    throw std::invalid_argument(fmt::format("network '{}': a sine's derivative does not follow from its value", name));
  layers_.reserve(shape.layers.size());
  for (size_t l = 0; l < shape.layers.size(); ++l) layers_.emplace_back(device, fmt::format("{} layer {}", name, l), shape.layers[l], parameters[l], gradients[l]);
}

void DenseNetwork::record_pack(Commands& commands, const BufferSlice& code) {
  for (Layer& layer : layers_) layer.record_pack(commands, layer.shape().constant_count ? code : BufferSlice{});
}

void DenseNetwork::make_half_weights(Device& device) {
  for (size_t l = 1; l < layers_.size(); ++l)
    if (static_cast<int>(l) != shape_.skip) layers_[l].make_half_weights(device);
}

void DenseNetwork::record_unpack(Commands& commands, const BufferSlice& code, const BufferSlice& code_gradient) {
  for (Layer& layer : layers_) layer.record_unpack(commands, layer.shape().constant_count ? code : BufferSlice{}, code_gradient);
}

uint64_t DenseNetwork::weight_gradient_scratch(uint32_t points) const {
  uint64_t most = 0;
  for (const LayerShape& layer : shape_.layers) most = std::max(most, weight_gradient_scratch_floats(layer.padded_inputs(), layer.padded_outputs(), points));
  return most;
}

std::vector<BufferSlice> DenseNetwork::effective_gradients() {
  std::vector<BufferSlice> all;
  for (Layer& layer : layers_) all.push_back(layer.effective_gradient());
  return all;
}

void DenseNetwork::record_forward(Commands& commands, DenseTape& tape, const PointRange& range) {
  for (size_t l = 0; l < layers_.size(); ++l) {
    LinearForwardArgs args;
    args.x = static_cast<int>(l) == shape_.skip ? tape.joined_ : tape.values_[l];
    args.weights = layers_[l].packed();
    args.y = tape.values_[l + 1];
    args.activation = shape_.activations[l];
    args.range = range;
    args.name = layers_[l].name() + ": forward";
    record_linear_forward(commands, args);
  }
}

void DenseNetwork::record_backward(Commands& commands, DenseTape& tape, const PointRange& range, const Backward& backward) {
  if (tape.adjoints_[0].empty()) throw std::invalid_argument(fmt::format("network '{}': backward on a tape without gradients", name_));
  const size_t last = layers_.size() - 1;
  const Matrix cotangent = backward.cotangent.empty() ? tape.output_gradient_ : backward.cotangent;
  auto through_activation = [&](const Matrix& dy, size_t l) {
    record_activation_gradient(commands, {dy, tape.values_[l + 1], tape.adjoints_[l], shape_.activations[l], shape_.layers[l].padded_outputs(), range.points,
                                          layers_[l].name() + ": activation gradient"});
  };
  Matrix adjoint = tape.adjoints_[last];
  if (shape_.activations[last] == Activation::none) adjoint = cotangent;
  else through_activation(cotangent, last);

  for (size_t l = last;; --l) {
    const bool joined = static_cast<int>(l) == shape_.skip;
    if (backward.weight_gradients) {
      LinearWeightGradientArgs weights;
      weights.x = joined ? tape.joined_ : tape.values_[l];
      weights.dy = adjoint;
      weights.inputs = shape_.layers[l].padded_inputs();
      weights.outputs = shape_.layers[l].padded_outputs();
      weights.points = range.points;
      weights.accumulate = backward.accumulate;
      weights.scratch = backward.scratch;
      weights.total = layers_[l].effective_gradient();
      weights.name = layers_[l].name() + ": weight gradient";
      record_linear_weight_gradient(commands, weights);
    }
    if (l == 0 && !backward.input_gradient) break;
    LinearInputGradientArgs input;
    input.dy = adjoint;
    input.weights = layers_[l].packed();
    input.range = range;
    input.name = layers_[l].name() + ": input gradient";
    if (joined) {
      input.result = tape.joined_gradient_;
      record_linear_input_gradient(commands, input);
      through_activation(tape.joined_gradient_.columns_from(shape_.padded_input()), l - 1);
    } else if (l == 0) {
      input.result = backward.input_gradient_result.empty() ? tape.input_gradient_ : backward.input_gradient_result;
      if (shape_.skip >= 0) input.before = tape.joined_gradient_;
      record_linear_input_gradient(commands, input);
      break;
    } else {
      input.result = tape.adjoints_[l - 1];
      input.activation_below = shape_.activations[l - 1];
      input.stored = tape.values_[l];
      record_linear_input_gradient(commands, input);
    }
    adjoint = tape.adjoints_[l - 1];
  }
}

}  // namespace arah
