// How raw parameters become effective weights, and how gradients come back to them.
#include "kernels/linear/layer.h"

#include <gtest/gtest.h>

#include <functional>
#include <iostream>

#include "kernels/reference/linear.h"
#include "tests/kernels/closeness.h"
#include "tests/kernels/device_fixture.h"
#include "tests/kernels/linear_truth.h"

namespace arah {
namespace {

// Raw parameters of a layer in double precision, as the device holds them: weight [outputs][inputs].
struct RawParameters {
  std::vector<double> weight, bias, first, shift, code;
};

// Effective weights by the definition in lib/parameterisation.glsl.
EffectiveWeights effective(const LayerShape& shape, const RawParameters& raw) {
  const uint32_t inputs = shape.inputs, outputs = shape.outputs;
  // scaled weights [inputs][outputs] and shifts
  std::vector<double> w = reference::transposed(raw.weight, outputs, inputs), b = raw.bias;
  if (shape.kind == LayerKind::weight_norm) w = reference::weight_norm_forward(inputs, outputs, w, raw.first);
  for (uint32_t m = 0; m < outputs && shape.kind != LayerKind::weight_norm; ++m) {
    const bool film = shape.kind == LayerKind::film;
    const double scale = shape.omega * (film ? raw.first[m] : 1.0);
    for (uint32_t k = 0; k < inputs; ++k) w[size_t(k) * outputs + m] *= scale;
    b[m] = scale * b[m] + (film ? shape.omega * raw.shift[m] : 0.0);
  }
  EffectiveWeights result{shape.padded_inputs(), shape.padded_outputs(), {}, {}};
  result.w.assign(size_t(result.inputs) * result.outputs, 0.0);
  result.b.assign(result.outputs, 0.0);
  for (uint32_t m = 0; m < outputs; ++m) {
    result.b[m] = b[m];
    uint32_t streamed = 0;
    for (uint32_t k = 0; k < inputs; ++k) {
      if (k >= shape.constant_first && k < shape.constant_first + shape.constant_count) {
        result.b[m] += w[size_t(k) * outputs + m] * raw.code[k - shape.constant_first];
        continue;
      }
      const uint32_t row = streamed < shape.gap_first ? streamed : streamed + shape.gap_count;
      result.w[size_t(row) * result.outputs + m] = w[size_t(k) * outputs + m];
      ++streamed;
    }
  }
  return result;
}

// d loss / d parameters by the five-point rule, which is exact to rounding for these smooth functions.
std::vector<double> numeric_gradient(const std::function<double()>& loss, std::vector<double>& parameters) {
  constexpr double step = 1e-3;
  std::vector<double> gradient;
  for (double& parameter : parameters) {
    const double original = parameter;
    const auto at = [&](double offset) {
      parameter = original + offset;
      return loss();
    };
    gradient.push_back((8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step));
    parameter = original;
  }
  return gradient;
}

class LayerTest : public DeviceTest, public testing::WithParamInterface<LayerShape> {};

void print_shape(const LayerShape& s) {
  std::cout << "kind " << static_cast<int>(s.kind) << ", " << s.inputs << " to " << s.outputs << ", constant "
            << s.constant_first << "+" << s.constant_count << ", gap " << s.gap_first << "+" << s.gap_count << "\n";
}

TEST_P(LayerTest, PacksItsWeightsAndHandsGradientsBack) {
  const LayerShape shape = GetParam();
  print_shape(shape);
  const size_t count = size_t(shape.inputs) * shape.outputs;
  const bool has_first = shape.kind != LayerKind::plain, has_shift = shape.kind == LayerKind::film;
  std::vector<float> weight = uniform(count);
  const size_t dead_row = shape.outputs - 1;  // weight norm of a row of zeros: no weights, no gradient
  if (shape.kind == LayerKind::weight_norm)
    std::fill(weight.begin() + long(dead_row * shape.inputs), weight.end(), 0.0f);
  const std::vector<float> bias = uniform(shape.outputs), first = uniform(shape.outputs, 0.5, 2),
                           shift = uniform(shape.outputs), code = uniform(std::max(shape.constant_count, 1u));
  Buffer weight_buffer = filled("weight", weight), bias_buffer = filled("bias", bias),
         first_buffer = filled("first", first), shift_buffer = filled("shift", shift),
         code_buffer = filled("code", code);
  // gradients are added to what is there
  const std::vector<float> before = uniform(count);
  Buffer d_weight = filled("d weight", before), d_bias = filled("d bias", before), d_first = filled("d first", before),
         d_shift = filled("d shift", before), d_code = filled("d code", before);
  LayerTensors parameters{weight_buffer.slice(), bias_buffer.slice(), {}, {}},
      gradients{d_weight.slice(), d_bias.slice(), {}, {}};
  if (has_first) parameters.first = first_buffer.slice(), gradients.first = d_first.slice();
  if (has_shift) parameters.shift = shift_buffer.slice(), gradients.shift = d_shift.slice();
  Layer layer(device, "layer", shape, parameters, gradients);
  const BufferSlice code_slice = shape.constant_count > 0 ? code_buffer.slice() : BufferSlice{};

  layer.record_pack(commands, code_slice);
  commands.submit_and_wait();
  RawParameters raw{as_doubles(weight), as_doubles(bias), as_doubles(first), as_doubles(shift), as_doubles(code)};
  const EffectiveWeights truth = effective(shape, raw);
  PackedWeights found = layer.packed();
  ASSERT_EQ(found.inputs, truth.inputs);
  ASSERT_EQ(found.outputs, truth.outputs);
  const double size = shape.kind == LayerKind::weight_norm ? 1 : shape.omega;
  expect_close(
      "packed",
      as_doubles(device.download<float>(found.forward.elements(0, packed_floats(truth.inputs, truth.outputs)))),
      as_doubles(packed_forward(truth)), 2e-6 * size);
  expect_close(
      "packed transposed",
      as_doubles(device.download<float>(found.transposed.elements(0, packed_floats(truth.outputs, truth.inputs)))),
      as_doubles(packed_transposed(truth)), 2e-6 * size);

  // any gradient at the effective weights; that at the padding must reach no parameter
  std::vector<float> d_effective = uniform(size_t(truth.inputs + 1) * truth.outputs);
  const auto loss = [&] {
    const EffectiveWeights now = effective(shape, raw);
    double sum = 0;
    for (size_t i = 0; i < now.w.size(); ++i) sum += now.w[i] * d_effective[i];
    for (size_t m = 0; m < now.b.size(); ++m) sum += now.b[m] * d_effective[now.w.size() + m];
    return sum;
  };
  device.upload(layer.effective_gradient(), d_effective);
  layer.record_unpack(commands, code_slice, shape.constant_count > 0 ? d_code.slice() : BufferSlice{});
  commands.submit_and_wait();
  const auto check = [&](const char* what, std::vector<double>& parameter, Buffer& gradient, size_t numbers,
                         size_t without_gradient_from) {
    std::vector<double> expected = numeric_gradient(loss, parameter);
    expected.resize(numbers);
    double largest = 1;
    for (size_t i = 0; i < numbers; ++i) {
      if (i >= without_gradient_from) expected[i] = 0;
      expected[i] += before[i];
      largest = std::max(largest, std::abs(expected[i]));
    }
    expect_close(what, as_doubles(device.download<float>(gradient.slice().elements(0, numbers))), expected,
                 1e-6 * largest);
  };
  const bool norm = shape.kind == LayerKind::weight_norm;
  check("gradient of the weights", raw.weight, d_weight, count, norm ? dead_row * shape.inputs : count);
  check("gradient of the bias", raw.bias, d_bias, shape.outputs, shape.outputs);
  if (has_first)
    check(norm ? "gradient of g" : "gradient of gamma", raw.first, d_first, shape.outputs,
          norm ? dead_row : shape.outputs);
  if (has_shift) check("gradient of eta", raw.shift, d_shift, shape.outputs, shape.outputs);
  if (shape.constant_count > 0)
    check("gradient of the constant inputs", raw.code, d_code, shape.constant_count, shape.constant_count);
}

// A plain layer smaller than its padding; weight norm of [input 11 + 5 constant, gap 5, hidden 5]; FiLM in tiles of 16
// and with constant inputs at the front.
INSTANTIATE_TEST_SUITE_P(Kinds, LayerTest,
                         testing::Values(LayerShape{LayerKind::plain, 5, 3, 0, 0, 0, 0, 2.5f},
                                         LayerShape{LayerKind::weight_norm, 21, 19, 11, 5, 11, 5, 1},
                                         LayerShape{LayerKind::weight_norm, 3, 70, 0, 0, 0, 0, 1},
                                         LayerShape{LayerKind::film, 30, 16, 0, 0, 0, 0, 30},
                                         LayerShape{LayerKind::film, 9, 8, 0, 4, 0, 0, 30}));

using LayerRefusal = DeviceTest;

TEST_F(LayerRefusal, OfConstantInputsThatItDoesNotHave) {
  Buffer weight = filled("weight", std::vector<float>(64)), bias = filled("bias", std::vector<float>(8));
  const LayerTensors tensors{weight.slice(), bias.slice(), {}, {}};
  EXPECT_THROW(Layer(device, "layer", {LayerKind::plain, 8, 8, 5, 4, 0, 0, 1}, tensors, tensors),
               std::invalid_argument);
  Layer layer(device, "layer", {LayerKind::plain, 8, 8, 4, 4, 0, 0, 1}, tensors, tensors);
  EXPECT_THROW(layer.record_pack(commands), std::invalid_argument) << "no code given";
}

}  // namespace
}  // namespace arah
