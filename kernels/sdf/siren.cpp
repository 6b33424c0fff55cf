#include "kernels/sdf/siren.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace arah {
namespace {
constexpr uint32_t narrow = channel_padding;  // width of matrices that hold one or three channels

void require(bool held, const std::string& name, const char* pass, const char* order) {
  if (!held) throw std::invalid_argument(fmt::format("SIREN '{}': {} needs a tape that holds {}", name, pass, order));
}

}  // namespace

SirenTape::SirenTape(Device& device, const std::string& name, const SirenShape& shape, uint32_t capacity, Holds holds, Element hidden, bool feature) : capacity_(padded_points(capacity)) {
  const uint32_t width = padded_channels(shape.width);
  struct Wanted {
    Matrix* matrix;
    uint32_t channels;
    Element element;
  };
  std::vector<Wanted> wanted;
  auto want = [&](Matrix& matrix, uint32_t channels, Element element = Element::float32) { wanted.push_back({&matrix, channels, element}); };
  auto want_all = [&](std::vector<Matrix>& matrices) {
    matrices.resize(shape.sine_layers);
    for (Matrix& matrix : matrices) want(matrix, width);
  };
  want(input_, narrow);
  want(sdf_, narrow);
  Matrix turns[2];
  sine_.resize(shape.sine_layers);
  // Among halves, a feature that is read elsewhere needs a matrix of its own.
  const bool apart = feature && hidden != Element::float32;
  if (holds == Holds::values) {
    for (size_t turn = 0; turn < std::min<size_t>(2, sine_.size() - (apart ? 1 : 0)); ++turn) want(turns[turn], width, hidden);
    if (apart) want(sine_.back(), width);
  } else {
    for (Matrix& matrix : sine_) want(matrix, width, apart && &matrix == &sine_.back() ? Element::float32 : hidden);
  }
  if (holds != Holds::values) {
    want_all(cosine_);
    want(gradient_, narrow);
    want(ones_, narrow);
    want_all(phase_adjoint_);
  }
  if (holds == Holds::first_order || holds == Holds::second_order) {
    want(sdf_cotangent_, narrow);
    want(feature_cotangent_, width);
    want(input_gradient_, narrow);
    want_all(loss_adjoint_);
  }
  if (holds == Holds::second_order) {
    want(gradient_cotangent_, narrow);
    want_all(adjoint_);
    want_all(tangent_);
    want_all(curvature_);
  }
  buffers_.reserve(wanted.size());
  for (const auto& [matrix, channels, element] : wanted) {
    buffers_.emplace_back(device, fmt::format("{} {}", name, buffers_.size()), uint64_t(capacity_) * channels * bytes_of(element), BufferPlace::device);
    *matrix = {buffers_.back().slice(), channels, 0, element};
  }
  if (holds == Holds::values)
    for (size_t l = 0; l + (apart ? 1 : 0) < sine_.size(); ++l) sine_[l] = turns[l % 2];
  Commands zero(device);
  for (Buffer& buffer : buffers_) zero.fill(buffer.slice(), 0);
  zero.submit_and_wait();
  if (!ones_.empty()) {  // df = 1 in channel 0: the cotangent whose pull-back is ∂f/∂n
    std::vector<float> ones(uint64_t(capacity_) * narrow, 0.0f);
    for (uint32_t p = 0; p < capacity_; ++p) ones[uint64_t(p) * narrow] = 1.0f;
    device.upload(ones_.slice, ones);
  }
}

Matrix SirenTape::input() { return input_; }
Matrix SirenTape::sdf() { return sdf_; }
Matrix SirenTape::feature() {
  if (sine_.back().element != Element::float32) throw std::logic_error("the feature of a SIREN's tape that was made without one, of halves");
  return sine_.back();
}
Matrix SirenTape::gradient() { return gradient_; }
Matrix SirenTape::sdf_cotangent() { return sdf_cotangent_; }
Matrix SirenTape::feature_cotangent() { return feature_cotangent_; }
Matrix SirenTape::gradient_cotangent() { return gradient_cotangent_; }
Matrix SirenTape::input_gradient() { return input_gradient_; }

Siren::Siren(Device& device, const std::string& name, const SirenShape& shape, const std::vector<LayerTensors>& parameters, const std::vector<LayerTensors>& gradients)
    : name_(name), shape_(shape) {
  if (shape.sine_layers == 0 || parameters.size() != shape.sine_layers + 1 || gradients.size() != parameters.size())
    throw std::invalid_argument(fmt::format("SIREN '{}': {} sine layers and one linear layer, tensors for {}", name, shape.sine_layers, parameters.size()));
  layers_.reserve(parameters.size());
  for (uint32_t l = 0; l <= shape.sine_layers; ++l) {
    LayerShape layer;
    const bool sine = l < shape.sine_layers;
    layer.kind = sine && shape.film ? LayerKind::film : LayerKind::plain;
    layer.inputs = l == 0 ? 3 : shape.width;
    layer.outputs = sine ? shape.width : 1;
    layer.omega = sine ? shape.omega : 1.0f;
    layers_.emplace_back(device, fmt::format("{} layer {}", name, l), layer, parameters[l], gradients[l]);
  }
}

void Siren::record_pack(Commands& commands) {
  for (Layer& layer : layers_) layer.record_pack(commands);
}

void Siren::make_half_weights(Device& device) {
  for (uint32_t l = 1; l < shape_.sine_layers; ++l) layers_[l].make_half_weights(device);
}

void Siren::record_unpack(Commands& commands) {
  for (Layer& layer : layers_) layer.record_unpack(commands);
}

uint64_t Siren::weight_gradient_scratch(uint32_t points) const {
  uint64_t most = 0;
  for (const Layer& layer : layers_) most = std::max(most, weight_gradient_scratch_floats(layer.shape().padded_inputs(), layer.shape().padded_outputs(), points));
  return most;
}

std::vector<BufferSlice> Siren::effective_gradients() {
  std::vector<BufferSlice> all;
  for (Layer& layer : layers_) all.push_back(layer.effective_gradient());
  return all;
}

void Siren::record_forward(Commands& commands, SirenTape& tape, const PointRange& range, bool keep) {
  require(!keep || !tape.cosine_.empty(), name_, "a forward pass that keeps its cosines", "the gradient");
  for (uint32_t l = 0; l <= shape_.sine_layers; ++l) {
    const bool sine = l < shape_.sine_layers;
    LinearForwardArgs args;
    args.x = l == 0 ? tape.input_ : tape.sine_[l - 1];
    args.weights = layers_[l].packed();
    args.y = sine ? tape.sine_[l] : tape.sdf_;
    args.activation = sine ? Activation::sine : Activation::none;
    if (sine && keep) args.cosine = tape.cosine_[l];
    args.range = range;
    args.name = layers_[l].name() + ": forward";
    record_linear_forward(commands, args);
  }
}

void Siren::record_gradient(Commands& commands, SirenTape& tape, const PointRange& range, bool keep_adjoints) {
  require(!tape.phase_adjoint_.empty(), name_, "the field gradient", "the gradient");
  require(!keep_adjoints || !tape.adjoint_.empty(), name_, "keeping the field gradient's adjoints", "second order");
  for (uint32_t l = shape_.sine_layers + 1; l-- > 0;) {
    LinearInputGradientArgs args;
    args.dy = l == shape_.sine_layers ? tape.ones_ : tape.phase_adjoint_[l];
    args.weights = layers_[l].packed();
    if (l == 0) {
      args.result = tape.gradient_;
    } else {
      args.result = tape.phase_adjoint_[l - 1];
      args.activation_below = Activation::sine;
      args.stored = tape.cosine_[l - 1];
      if (keep_adjoints) args.raw = tape.adjoint_[l - 1];
    }
    args.range = range;
    args.name = layers_[l].name() + ": field gradient";
    record_linear_input_gradient(commands, args);
  }
}

void Siren::record_backward(Commands& commands, SirenTape& tape, const PointRange& range, const Backward& backward) {
  require(!tape.loss_adjoint_.empty(), name_, "the backward pass", "first order");
  require(!backward.gradient || !tape.tangent_.empty(), name_, "a cotangent on the field gradient", "second order");
  if (backward.gradient) {
    for (uint32_t l = 0; l < shape_.sine_layers; ++l) {
      LinearTangentArgs args;
      args.x = l == 0 ? tape.gradient_cotangent_ : tape.tangent_[l - 1];
      args.weights = layers_[l].packed();
      args.y = tape.tangent_[l];
      args.cosine = tape.cosine_[l];
      args.sine = tape.sine_[l];
      args.adjoint = tape.adjoint_[l];
      args.curvature = tape.curvature_[l];
      args.range = range;
      args.name = layers_[l].name() + ": tangent";
      record_linear_tangent(commands, args);
    }
  }
  for (uint32_t l = shape_.sine_layers + 1; l-- > 0;) {
    const bool last = l == shape_.sine_layers;
    const Matrix adjoint = last ? tape.sdf_cotangent_ : tape.loss_adjoint_[l];
    LinearWeightGradientArgs weights;
    weights.x = l == 0 ? tape.input_ : tape.sine_[l - 1];
    weights.dy = adjoint;
    weights.inputs = layers_[l].shape().padded_inputs();
    weights.outputs = layers_[l].shape().padded_outputs();
    weights.points = range.points;
    weights.accumulate = backward.accumulate;
    weights.scratch = backward.scratch;
    weights.total = layers_[l].effective_gradient();
    weights.name = layers_[l].name() + ": weight gradient";
    record_linear_weight_gradient(commands, weights);
    if (backward.gradient) {
      // ∂f/∂n·v runs through φ̇_l = ḣ_l W_l, whose adjoint is ∂f/∂φ_l (1 for the last, linear layer)
      weights.x = l == 0 ? tape.gradient_cotangent_ : tape.tangent_[l - 1];
      weights.dy = last ? tape.ones_ : tape.phase_adjoint_[l];
      weights.accumulate = true;
      weights.with_bias = false;
      weights.name = layers_[l].name() + ": weight gradient of the tangent";
      record_linear_weight_gradient(commands, weights);
    }
    if (l == 0 && !backward.input_gradient) break;
    LinearInputGradientArgs input;
    input.dy = adjoint;
    input.weights = layers_[l].packed();
    input.range = range;
    input.name = layers_[l].name() + ": input gradient";
    if (last && backward.feature) input.before = tape.feature_cotangent_;
    if (l == 0) {
      input.result = tape.input_gradient_;
    } else {
      input.result = tape.loss_adjoint_[l - 1];
      input.activation_below = Activation::sine;
      input.stored = tape.cosine_[l - 1];
      if (backward.gradient) input.after = tape.curvature_[l - 1];
    }
    record_linear_input_gradient(commands, input);
  }
}

}  // namespace arah
