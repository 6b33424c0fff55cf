#include "kernels/linear/layer.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/linear/cooperative.h"

namespace arah {
namespace {

struct ParameterisationConstants {  // shaders/lib/parameterisation.glsl
  uint32_t inputs, outputs, padded_inputs, padded_outputs, constant_first, constant_count, gap_first, gap_count;
  float omega;
};

ParameterisationConstants constants_of(const LayerShape& s) {
  return {s.inputs, s.outputs, s.padded_inputs(), s.padded_outputs(), s.constant_first, s.constant_count, s.gap_first, s.gap_count, s.omega};
}

void check_code(const std::string& name, const LayerShape& shape, const BufferSlice& code) {
  if (shape.constant_count && code.bytes < shape.constant_count * 4ull)
    throw std::invalid_argument(fmt::format("layer '{}': {} constant inputs, {} bytes given", name, shape.constant_count, code.bytes));
}

// An unused binding must name some buffer: the weights stand in.
BufferSlice or_weights(const BufferSlice& slice, const LayerTensors& tensors) { return slice.empty() ? tensors.weight : slice; }

}  // namespace

Layer::Layer(Device& device, const std::string& name, const LayerShape& shape, const LayerTensors& parameters, const LayerTensors& gradients)
    : name_(name), shape_(shape), parameters_(parameters), gradients_(gradients) {
  if (shape.inputs == 0 || shape.outputs == 0 || shape.constant_first + shape.constant_count > shape.inputs)
    throw std::invalid_argument(fmt::format("layer '{}': {} inputs, {} outputs, constant inputs [{}, +{})", name, shape.inputs, shape.outputs, shape.constant_first, shape.constant_count));
  const uint32_t in = shape.padded_inputs(), out = shape.padded_outputs();
  forward_ = Buffer(device, name + " packed", packed_floats(in, out) * 4, BufferPlace::device);
  transposed_ = Buffer(device, name + " packed transposed", packed_floats(out, in) * 4, BufferPlace::device);
  scales_ = Buffer(device, name + " scales", uint64_t(out) * 8, BufferPlace::device);
  effective_gradient_ = Buffer(device, name + " effective gradient", uint64_t(in + 1) * out * 4, BufferPlace::device);
}

PackedWeights Layer::packed() { return {shape_.padded_inputs(), shape_.padded_outputs(), forward_.slice(), transposed_.slice(), halves_.bytes() ? halves_.slice() : BufferSlice{}}; }

void Layer::make_half_weights(Device& device) {
  const uint32_t in = shape_.padded_inputs(), out = shape_.padded_outputs();
  if (cooperative_product(in, out)) halves_ = Buffer(device, name_ + " packed as halves", half_weights_bytes(in, out), BufferPlace::device);
}

void Layer::record_pack(Commands& commands, const BufferSlice& code) {
  check_code(name_, shape_, code);
  const ParameterisationConstants constants = constants_of(shape_);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("linear/pack_weights", {static_cast<uint32_t>(shape_.kind), linear_tile(constants.padded_inputs, constants.padded_outputs), linear_tile(constants.padded_outputs, constants.padded_inputs)});
  launch.name = name_ + ": pack weights";
  launch.groups = {padded_points(constants.padded_outputs) / 64, 1, 1};
  launch.bindings = {{parameters_.weight, uint64_t(shape_.inputs) * shape_.outputs * 4}, {parameters_.bias, shape_.outputs * 4ull}, or_weights(parameters_.first, parameters_),
                     or_weights(parameters_.shift, parameters_), or_weights(code, parameters_), forward_.slice(), transposed_.slice(), scales_.slice()};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {2.0 * shape_.inputs * shape_.outputs, 12.0 * shape_.inputs * shape_.outputs};
  commands.dispatch(launch);
  if (halves_.bytes()) record_half_weights(commands, packed(), name_ + ": weights as halves");
}

void Layer::record_unpack(Commands& commands, const BufferSlice& code, const BufferSlice& code_gradient) {
  check_code(name_, shape_, code);
  const ParameterisationConstants constants = constants_of(shape_);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("linear/unpack_gradient", {static_cast<uint32_t>(shape_.kind)});
  launch.name = name_ + ": unpack gradient";
  launch.groups = {padded_points(shape_.outputs) / 64, 1, 1};
  launch.bindings = {effective_gradient_.slice(), parameters_.weight, parameters_.bias, or_weights(code, parameters_), scales_.slice(), {gradients_.weight, uint64_t(shape_.inputs) * shape_.outputs * 4},
                     gradients_.bias, or_weights(gradients_.first, gradients_), or_weights(gradients_.shift, gradients_)};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {4.0 * shape_.inputs * shape_.outputs, 16.0 * shape_.inputs * shape_.outputs};
  commands.dispatch(launch);
  if (shape_.constant_count && !code_gradient.empty()) {
    launch.pipeline = &commands.device().pipeline("linear/constant_input_gradient");
    launch.name = name_ + ": gradient of the constant inputs";
    launch.groups = {padded_points(shape_.constant_count) / 64, 1, 1};
    launch.bindings = {effective_gradient_.slice(), parameters_.weight, scales_.slice(), {code_gradient, shape_.constant_count * 4ull}};
    launch.cost = {2.0 * shape_.constant_count * shape_.outputs, 8.0 * shape_.constant_count * shape_.outputs};
    commands.dispatch(launch);
  }
}

}  // namespace arah
