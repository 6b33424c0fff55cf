#include "kernels/conditioning/pose_networks.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "kernels/linear/matrix.h"
#include "kernels/optimizer/sum_of_squares.h"
#include "kernels/reduction/add.h"

namespace arah {
namespace {

constexpr uint64_t alignment = 64;  // floats: every device's binding alignment, and whole tiles of eight
uint64_t aligned(uint64_t floats) { return (floats + alignment - 1) / alignment * alignment; }

}  // namespace

PoseNetworks::PoseNetworks(Device& device, const std::string& name, const PoseNetworksShape& shape, const PoseNetworksTensors& parameters,
                                   const shared::PoseEncoderConstants& encoder_at, const PoseNetworksTensors* gradients, uint32_t frames)
    : name_(name), shape_(shape), parameters_(parameters), encoder_at_(encoder_at) {
  if (shape.width == 0 || shape.width % 8 || shape.hidden_layers == 0 || parameters.hidden.size() != shape.hidden_layers || parameters.layers.size() != shape.layers.size() || shape.layers.empty() || frames == 0)
    throw std::invalid_argument(fmt::format("pose networks '{}': width {}, {} hidden layers, tensors for {}; {} layers of the SIREN, tensors for {}", name, shape.width, shape.hidden_layers,
                                            parameters.hidden.size(), shape.layers.size(), parameters.layers.size()));
  const auto make = [&](const char* what, uint64_t floats) {
    Buffer buffer(device, fmt::format("{} {}", name, what), aligned(floats) * 4, BufferPlace::device);
    Commands zero(device);
    zero.fill(buffer.slice(), 0);
    zero.submit_and_wait();
    return buffer;
  };
  for (const auto& [outputs, inputs] : shape.layers) {
    weights_.push_back({generated_floats_, uint64_t(outputs) * inputs});
    generated_floats_ += aligned(weights_.back().count);
    biases_.push_back({generated_floats_, outputs});
    generated_floats_ += aligned(outputs);
  }
  const uint64_t joints = shape.joints(), h = uint64_t(shape.layers.size()) * shape.width;
  parents_ = make("joint tree", joints);
  device.upload(parents_.slice(), std::vector<int32_t>(shape.parents.begin(), shape.parents.end()));
  pose_ = make("pose", joints * shared::pose_channels);
  inputs_ = make("joints' inputs", joints * shared::pose_hidden);
  hidden_ = make("joints' hidden values", joints * shared::pose_hidden);
  code_ = make("code", shape.code());
  generated_ = make("generated parameters", generated_floats_);
  uint64_t partials = 1;
  for (uint32_t i = 0; i < shape.hidden_layers; ++i) {
    HiddenBuffers& layer = layers_.emplace_back();
    layer.a = make("pre-activations", h);
    layer.normalised = make("normalised values", h);
    layer.inverse_deviation = make("inverse deviations", shape.layers.size());
    layer.y = make("activations", h);
    if (!gradients) continue;
    layer.d_a = make("gradient of pre-activations", h);
    layer.d_y = make("gradient of activations", h);
    partials = std::max(partials, vector_layer_partials(hidden_layer(i)));
  }
  if (!gradients) return;
  gradients_ = *gradients;
  d_pose_ = make("gradient of the pose", joints * shared::pose_channels);
  d_code_ = make("gradient of the code", shape.code());
  d_generated_ = make("gradient of the generated parameters", generated_floats_);
  uint64_t squares = 0;
  for (uint32_t l = 0; l < shape.layers.size(); ++l) {
    squares += squares_partials(aligned(weights_[l].count));
    partials = std::max({partials, shape.change == PoseChange::dense ? vector_layer_partials(dense_layer(l, false)) : 0, uint64_t(shape.layers[l][0]) * shape.width});
  }
  partials_ = make("partial sums", partials);
  squares_ = make("partial sums of squares", squares * sizeof(shared::SquaresPartial) / 4);
  norm_ = make("norm", sizeof(shared::GradientNorm) / 4);
  if (shape.change != PoseChange::dense) return;
  kept_d_generated_ = make("gradients of the step's frames", frames * generated_floats_);
  kept_h_ = make("activations of the step's frames", frames * aligned(h));
}

LayerTensors PoseNetworks::tensors(Buffer& buffer, uint32_t l) {
  LayerTensors result;
  result.weight = buffer.slice().elements(weights_[l].at, weights_[l].count);
  result.bias = buffer.slice().elements(biases_[l].at, biases_[l].count);
  return result;
}

VectorLayer PoseNetworks::hidden_layer(uint32_t i) const {
  const auto count = static_cast<uint32_t>(shape_.layers.size());
  // The first layers of all networks read the code: one matrix.
  if (i == 0) return {count * shape_.width, shape_.code(), 1, false, "hypernetwork layer 0"};
  return {shape_.width, shape_.width, count, true, "hypernetwork, inner layer"};
}

VectorLayer PoseNetworks::dense_layer(uint32_t l, bool bias) const {
  return {static_cast<uint32_t>(bias ? biases_[l].count : weights_[l].count), shape_.width, 1, false, "hypernetwork, last layer"};
}

PoseCodeArgs PoseNetworks::code_args() {
  return {shape_.joints(), parents_.slice(), pose_.slice(), parameters_.encoder, encoder_at_, inputs_.slice(), hidden_.slice(), code_.slice()};
}

LayerNormArgs PoseNetworks::norm_args(uint32_t i) {
  HiddenBuffers& layer = layers_[i];
  return {static_cast<uint32_t>(shape_.layers.size()), shape_.width, layer.a.slice(), parameters_.hidden[i].scale, parameters_.hidden[i].shift,
          layer.normalised.slice(), layer.inverse_deviation.slice(), layer.y.slice()};
}

void PoseNetworks::record_forward(Commands& commands) {
  record_pose_code(commands, code_args());
  for (uint32_t i = 0; i < shape_.hidden_layers; ++i) {
    record_vector_layer(commands, {hidden_layer(i), parameters_.hidden[i].w, i == 0 ? code_.slice() : layers_[i - 1].y.slice(), parameters_.hidden[i].b, layers_[i].a.slice()});
    record_layer_norm(commands, norm_args(i));
  }
  const BufferSlice h = layers_.back().y.slice();
  for (uint32_t l = 0; l < shape_.layers.size(); ++l) {
    const PoseNetworksTensors::Change& change = parameters_.layers[l];
    const LayerTensors result = generated(l);
    if (shape_.change == PoseChange::dense) {
      record_vector_layer(commands, {dense_layer(l, false), change.dense_w, h, change.base_w, result.weight, l * shape_.width});
      record_vector_layer(commands, {dense_layer(l, true), change.dense_b, h, change.base_b, result.bias, l * shape_.width});
    } else {
      record_low_rank(commands, {shape_.layers[l][0], shape_.layers[l][1], shape_.width, change.low_rank, h, l * shape_.width, change.base_w, change.base_b, result.weight, result.bias});
    }
  }
}

void PoseNetworks::record_shared(Commands& commands) {
  for (uint32_t l = 0; l < shape_.layers.size(); ++l) {
    commands.copy(parameters_.layers[l].base_w, generated_.slice().elements(weights_[l].at, aligned(weights_[l].count)));
    commands.copy(parameters_.layers[l].base_b, generated_.slice().elements(biases_[l].at, aligned(biases_[l].count)));
  }
}

void PoseNetworks::record_shared_backward(Commands& commands) {
  for (uint32_t l = 0; l < shape_.layers.size(); ++l) {
    record_add(commands, d_generated_.slice().elements(weights_[l].at, aligned(weights_[l].count)), gradients_.layers[l].base_w, "gradient of the shared parameters");
    record_add(commands, d_generated_.slice().elements(biases_[l].at, aligned(biases_[l].count)), gradients_.layers[l].base_b, "gradient of the shared parameters");
  }
}

void PoseNetworks::record_clear_gradient(Commands& commands) { commands.fill(d_generated_.slice(), 0); }

void PoseNetworks::record_parameter_norm(Commands& commands, float weight, const BufferSlice& losses, uint32_t slot) {
  ParameterNormArgs args;
  for (const Place& place : weights_)
    args.parts.push_back({generated_.slice().elements(place.at, aligned(place.count)), d_generated_.slice().elements(place.at, place.count), place.count});
  args.weight = weight;
  args.losses = losses;
  args.slot = slot;
  args.partials = squares_.slice();
  args.norm = norm_.slice();
  arah::record_parameter_norm(commands, args);
}

void PoseNetworks::record_backward(Commands& commands, uint32_t frame) {
  if (!d_generated_.bytes()) throw std::logic_error("pose networks '" + name_ + "' was made without gradients");
  HiddenBuffers& last = layers_.back();
  const uint64_t h_floats = aligned(uint64_t(shape_.layers.size()) * shape_.width);
  record_shared_backward(commands);
  commands.fill(d_code_.slice(), 0);
  for (HiddenBuffers& layer : layers_) commands.fill(layer.d_y.slice(), 0);
  for (uint32_t l = 0; l < shape_.layers.size(); ++l) {
    const PoseNetworksTensors::Change& change = parameters_.layers[l];
    if (shape_.change == PoseChange::dense) {
      record_vector_layer_input_gradient(commands, {dense_layer(l, false), change.dense_w, d_generated_.slice().elements(weights_[l].at, aligned(weights_[l].count)), partials_.slice(), last.d_y.slice(), l * shape_.width});
      record_vector_layer_input_gradient(commands, {dense_layer(l, true), change.dense_b, d_generated_.slice().elements(biases_[l].at, aligned(biases_[l].count)), partials_.slice(), last.d_y.slice(), l * shape_.width});
    } else {
      LowRankBackwardArgs back;
      back.forward = {shape_.layers[l][0], shape_.layers[l][1], shape_.width, change.low_rank, last.y.slice(), l * shape_.width, {}, {}, {}, {}};
      back.d_w = d_generated_.slice().elements(weights_[l].at, aligned(weights_[l].count));
      back.d_b = generated_gradient(l).bias;
      back.partials = partials_.slice();
      back.gradients = gradients_.layers[l].low_rank;
      back.d_h = last.d_y.slice();
      record_low_rank_backward(commands, back);
    }
  }
  if (shape_.change == PoseChange::dense) {
    commands.copy(d_generated_.slice(), kept_d_generated_.slice().elements(frame * generated_floats_, generated_floats_));
    commands.copy(last.y.slice(), kept_h_.slice().elements(frame * h_floats, h_floats));
  }
  for (uint32_t i = shape_.hidden_layers; i-- > 0;) {
    const PoseNetworksTensors::Hidden &p = parameters_.hidden[i], &g = gradients_.hidden[i];
    record_layer_norm_backward(commands, {norm_args(i), layers_[i].d_y.slice(), g.scale, g.shift, layers_[i].d_a.slice()});
    const VectorLayer layer = hidden_layer(i);
    const BufferSlice x = i == 0 ? code_.slice() : layers_[i - 1].y.slice();
    record_vector_layer_weight_gradient(commands, {layer, layers_[i].d_a.slice(), x, g.w, g.b});
    record_vector_layer_input_gradient(commands, {layer, p.w, layers_[i].d_a.slice(), partials_.slice(), i == 0 ? d_code_.slice() : layers_[i - 1].d_y.slice()});
  }
  record_pose_code_backward(commands, {code_args(), d_code_.slice(), gradients_.encoder, d_pose_.slice()});
}

OuterProduct PoseNetworks::outer(uint32_t l, const Place& place, uint32_t frames) {
  const uint64_t h_floats = aligned(uint64_t(shape_.layers.size()) * shape_.width);
  OuterProduct product;
  product.pairs = frames;
  product.a = kept_d_generated_.slice().elements(place.at, (frames - 1) * generated_floats_ + aligned(place.count));
  product.rows = static_cast<uint32_t>(place.count);
  product.row_stride = static_cast<uint32_t>(generated_floats_);
  product.b = kept_h_.slice();
  product.columns = shape_.width;
  product.first_column = l * shape_.width;
  product.column_stride = static_cast<uint32_t>(h_floats);
  return product;
}

OuterProduct PoseNetworks::dense_w_gradient(uint32_t l, uint32_t frames) { return outer(l, weights_[l], frames); }
OuterProduct PoseNetworks::dense_b_gradient(uint32_t l, uint32_t frames) { return outer(l, biases_[l], frames); }

}  // namespace arah
