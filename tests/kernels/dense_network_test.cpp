// The skinning, colour and mapping networks on the device: golden cases, and random networks against the
// double-precision truth.
#include "kernels/linear/dense_network.h"

#include <gtest/gtest.h>

#include "kernels/reference/color.h"
#include "kernels/reference/lbs.h"
#include "tests/golden_tolerance.h"
#include "tests/kernels/device_networks.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah {
namespace {

using golden::expect_golden_float;

class DenseNetworkTest : public DeviceTest {
 protected:
  std::vector<double> numbers(size_t count, double range) {
    const std::vector<float> values = uniform(count, -range, range);
    return {values.begin(), values.end()};
  }
};

// Columns [first, first + count) of rows of `width`.
std::vector<double> columns(const std::vector<double>& rows, size_t width, size_t first, size_t count) {
  std::vector<double> result;
  for (size_t p = 0; p < rows.size() / width; ++p)
    for (size_t c = 0; c < count; ++c) result.push_back(rows.at(p * width + first + c));
  return result;
}

TEST_F(DenseNetworkTest, MatchesTheGoldenSkinningNetwork) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("03_lbs_net");
  const reference::SkinningNetwork network = reference::golden_skinning(truth, truth);
  const std::vector<double> x = truth.values("in.x"), bones = truth.values("in.B");
  const uint32_t points = static_cast<uint32_t>(truth.extent("in.x", 0));
  std::vector<double> n;
  for (uint32_t p = 0; p < points; ++p)
    for (double value : network.cube.to_cube({x[p * 3], x[p * 3 + 1], x[p * 3 + 2]})) n.push_back(value);

  // dL/dlogits of L = Σ G·x̄, in double precision: everything after the network is the truth's
  const std::vector<double> scaled = times(truth.values("out.logits"), network.logit_scale);
  const std::vector<double> weights = reference::hierarchical_softmax_forward(network.tree, points, scaled);
  reference::LbsGradients lbs = reference::lbs_backward(points, weights, bones, x, truth.values("in.G"), {});
  const std::vector<double> d_logits =
      times(reference::hierarchical_softmax_backward(network.tree, points, scaled, lbs.weights), network.logit_scale);

  DeviceDense on(device, network.layers, points);
  on.write_input(n, points);
  on.run(commands, points, d_logits);
  expect_golden_float(truth, "out.logits", on.output(points));
  expect_golden_gradients(truth, "lbs", on.tensors.download_gradients());
  const std::vector<double> d_n = read_rows(device, on.tape.input_gradient(), points, 3);
  for (size_t i = 0; i < d_n.size(); ++i) lbs.x[i] += network.cube.scale() * d_n[i];
  expect_golden_float(truth, "grad.x", lbs.x);
}

void expect_golden_color(Device& device, Commands& commands, const golden::Case& truth,
                         const golden::Case& parameters) {
  reference::DenseNetwork network =
      reference::golden_dense(parameters, "col", reference::Activation::relu, reference::Activation::sigmoid);
  network.layers[3].concatenates_input = true;
  const uint32_t points = static_cast<uint32_t>(truth.extent("in.x", 0));
  reference::ColorInputs inputs;
  inputs.x = truth.values("in.x");
  if (truth.has("in.view")) inputs.view = truth.values("in.view");
  inputs.normal = truth.values("in.normal");
  inputs.feature = truth.values("in.z");

  DeviceDense on(device, network, points, truth.values("in.Z"));
  on.write_input(reference::color_input(points, inputs), points);
  on.run(commands, points, truth.values("in.G"));
  expect_golden_float(truth, "out.rgb", on.output(points));
  expect_golden_gradients(truth, "col", on.tensors.download_gradients());
  const std::vector<float> d_code = device.download<float>(on.code_gradient_slice());
  expect_golden_float(truth, "grad.Z", std::vector<double>(d_code.begin(), d_code.end()));

  const size_t features = static_cast<size_t>(truth.extent("in.z", 1)), view = inputs.view.empty() ? 0 : 27;
  const size_t width = 3 + view + 3 + features;
  const std::vector<double> d_input = read_rows(device, on.tape.input_gradient(), points, width);
  expect_golden_float(truth, "grad.x", columns(d_input, width, 0, 3));
  expect_golden_float(truth, "grad.normal", columns(d_input, width, 3 + view, 3));
  expect_golden_float(truth, "grad.z", columns(d_input, width, 6 + view, features));
  if (view)
    expect_golden_float(truth, "grad.view",
                        reference::view_encoding_backward(points, inputs.view, reference::kViewOctaves,
                                                          columns(d_input, width, 3, view)));
}

TEST_F(DenseNetworkTest, MatchesTheGoldenColorNetwork) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  expect_golden_color(device, commands, golden::Case("06_colour"), golden::Case("06_colour_params"));
}

TEST_F(DenseNetworkTest, MatchesTheGoldenColorNetworkWithoutView) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("06_colour_noview");
  expect_golden_color(device, commands, truth, truth);
}

TEST_F(DenseNetworkTest, MatchesTheGoldenMappingNetwork) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("05_mapping");
  const reference::DenseNetwork network =
      reference::golden_dense(truth, "map", reference::Activation::leaky_relu, reference::Activation::none);
  const uint32_t codes = static_cast<uint32_t>(truth.extent("in.Z", 0));
  DeviceDense on(device, network, codes);
  on.write_input(truth.values("in.Z"), codes);
  on.run(commands, codes, truth.values("in.G"));
  const std::vector<double> output = on.output(codes);
  expect_golden_float(truth, "out.gamma", columns(output, 192, 0, 96));
  expect_golden_float(truth, "out.eta", columns(output, 192, 96, 96));
  expect_golden_gradients(truth, "map", on.tensors.download_gradients());
  expect_golden_float(truth, "grad.Z", read_rows(device, on.tape.input_gradient(), codes, 128));
}

struct RandomCase {
  const char* name;
  bool weight_norm;
  std::vector<uint32_t> widths;
  reference::Activation hidden, last;
  int skip;
  uint32_t constant_inputs, points, capacity;
};

class RandomDense : public DenseNetworkTest, public testing::WithParamInterface<RandomCase> {
 protected:
  reference::DenseNetwork random_network(const RandomCase& c) {
    reference::DenseNetwork network;
    for (size_t l = 0; l + 1 < c.widths.size(); ++l) {
      reference::DenseLayer layer;
      layer.concatenates_input = static_cast<int>(l) == c.skip;
      layer.inputs = c.widths[l] + (layer.concatenates_input ? c.widths[0] : 0);
      layer.outputs = c.widths[l + 1];
      layer.activation = l + 2 == c.widths.size() ? c.last : c.hidden;
      layer.v = numbers(layer.inputs * layer.outputs, c.weight_norm ? 1 : 0.5);
      if (c.weight_norm) layer.g = numbers(layer.outputs, 1.5);
      layer.b = numbers(layer.outputs, 0.3);
      network.layers.push_back(std::move(layer));
    }
    return network;
  }

  // Rows of streamed inputs with the code after each.
  std::vector<double> with_code(const std::vector<double>& x, size_t points, const std::vector<double>& code) {
    std::vector<double> rows;
    const size_t streamed = x.size() / points;
    for (size_t p = 0; p < points; ++p) {
      const auto begin = x.begin() + static_cast<std::ptrdiff_t>(p * streamed);
      rows.insert(rows.end(), begin, begin + static_cast<std::ptrdiff_t>(streamed));
      rows.insert(rows.end(), code.begin(), code.end());
    }
    return rows;
  }
};

TEST_P(RandomDense, MatchesTheTruth) {
  const RandomCase& c = GetParam();
  const uint32_t points = c.points, width = c.widths.front(), streamed = width - c.constant_inputs,
                 outputs = c.widths.back();
  const reference::DenseNetwork truth = random_network(c);
  const std::vector<double> x = numbers(points * streamed, 1), code = numbers(c.constant_inputs, 1);
  const std::vector<double> d_first = numbers(points * outputs, 1), d_second = numbers(points * outputs, 1);
  DeviceDense on(device, truth, c.capacity, code);
  on.write_input(x, points);
  on.write_cotangent(on.tape.output_gradient(), d_first, points);
  Buffer elsewhere = filled("other cotangent", std::vector<float>(on.tape.capacity() * padded_channels(outputs)));
  Buffer result = filled("other result", std::vector<float>(on.tape.capacity() * (on.shape.padded_input() + 8)));
  const Matrix other_cotangent{elsewhere.slice(), padded_channels(outputs), 0};
  const Matrix other_result{result.slice(), on.shape.padded_input() + 8, 8};
  on.write_cotangent(other_cotangent, d_second, points);

  const PointRange range{points, {}};
  DenseNetwork::Backward weights;  // of the first cotangent, without the input gradient
  weights.scratch = on.scratch.slice();
  DenseNetwork::Backward more = weights;  // += those of the second, with its input gradient in a matrix of the caller
  more.cotangent = other_cotangent;
  more.accumulate = more.input_gradient = true;
  more.input_gradient_result = other_result;
  DenseNetwork::Backward input;  // the input gradient of the first alone: the weight gradients stay
  input.weight_gradients = false;
  input.input_gradient = true;
  on.network.record_pack(commands, on.code_slice());
  on.network.record_forward(commands, on.tape, range);
  on.network.record_backward(commands, on.tape, range, weights);
  on.network.record_backward(commands, on.tape, range, weights);  // replaces
  on.network.record_backward(commands, on.tape, range, more);
  on.network.record_backward(commands, on.tape, range, input);
  on.network.record_unpack(commands, on.code_slice(), on.code_gradient_slice());
  on.network.record_unpack(commands, on.code_slice(), on.code_gradient_slice());  // doubles the raw gradients
  commands.submit_and_wait();

  reference::DenseNetwork gradients = truth.zeros();
  const reference::DenseTape tape = reference::dense_forward(truth, points, with_code(x, points, code));
  const std::vector<double> d_x_first = reference::dense_backward(truth, tape, d_first, &gradients);
  const std::vector<double> d_x_second = reference::dense_backward(truth, tape, d_second, &gradients);
  const double relative = 4e-6;  // of the largest number
  expect_near("output", on.output(points), tape.output, relative);
  expect_near("d", on.tensors.download_gradients(), raw_layers(gradients), 2, relative);
  expect_near("d input", read_rows(device, on.tape.input_gradient(), points, streamed),
              columns(d_x_first, width, 0, streamed), relative);
  expect_near("d input elsewhere", read_rows(device, other_result, points, streamed),
              columns(d_x_second, width, 0, streamed), relative);
  for (float value : device.download<float>(result.slice().sub(0, 32))) EXPECT_EQ(value, 0.0f) << "beside the result";
  if (c.constant_inputs) {
    std::vector<double> d_code(c.constant_inputs, 0.0);
    for (uint32_t p = 0; p < points; ++p)
      for (uint32_t j = 0; j < c.constant_inputs; ++j)
        d_code[j] += 2 * (d_x_first[p * width + streamed + j] + d_x_second[p * width + streamed + j]);
    const std::vector<float> found = device.download<float>(on.code_gradient_slice());
    expect_near("d code", std::vector<double>(found.begin(), found.end()), d_code, relative);
  }
}

using enum reference::Activation;

INSTANTIATE_TEST_SUITE_P(
    Shapes, RandomDense,
    testing::Values(RandomCase{"SkinningLike", true, {3, 24, 24, 10}, softplus, none, -1, 0, 65, 200},
                    RandomCase{"MappingLike", false, {13, 24, 24, 10}, leaky_relu, none, -1, 0, 1, 1},
                    RandomCase{"ColorLike", true, {19, 24, 13, 24, 3}, relu, sigmoid, 2, 5, 63, 63},
                    RandomCase{"SkipWithoutCode", true, {11, 24, 24, 24, 3}, relu, sigmoid, 2, 0, 65, 130},
                    RandomCase{"SkipIntoTheSecondLayer", true, {11, 13, 24, 3}, relu, sigmoid, 1, 0, 65, 65},
                    RandomCase{"SkipAtTheEndWithoutGap", false, {29, 24, 13, 3}, relu, none, 2, 5, 1000, 1000},
                    RandomCase{"OneLayerWithCode", true, {10, 3}, relu, sigmoid, -1, 7, 65, 65},
                    RandomCase{"CodeAlone", false, {16, 24, 3}, leaky_relu, sigmoid, -1, 15, 65, 65}),
    [](const testing::TestParamInfo<RandomCase>& test) { return std::string(test.param.name); });

TEST_F(DenseNetworkTest, RefusesWhatDoesNotFit) {
  const DenseShape three = DenseShape::chain(LayerKind::plain, {9, 8, 8, 3}, Activation::relu, Activation::none);
  EXPECT_THROW(three.with_skip(0), std::invalid_argument);
  EXPECT_THROW(three.with_skip(3), std::invalid_argument);
  EXPECT_THROW(three.with_skip(2).with_skip(2), std::invalid_argument);
  const DenseShape plain = DenseShape::chain(LayerKind::plain, {9, 8, 3}, Activation::relu, Activation::none, 2);
  const std::vector<RawLayer> raw{{std::vector<double>(72), std::vector<double>(8), {}, {}},
                                  {std::vector<double>(24), std::vector<double>(3), {}, {}}};
  DeviceTensors tensors(device, raw);
  // a sine's derivative cannot be had from its value
  EXPECT_THROW(
      DenseNetwork(device, "sines", DenseShape::chain(LayerKind::plain, {9, 8, 3}, Activation::sine, Activation::none),
                   tensors.parameters(), tensors.gradients()),
      std::invalid_argument);
  EXPECT_THROW(DenseNetwork(device, "short", plain, {tensors.parameters()[0]}, {tensors.gradients()[0]}),
               std::invalid_argument);
  DenseNetwork network(device, "network", plain, tensors.parameters(), tensors.gradients());
  EXPECT_THROW(network.record_pack(commands), std::invalid_argument) << "no code";
  EXPECT_THROW(network.record_unpack(commands), std::invalid_argument) << "no code";
  DenseTape values(device, "values", plain, 64, false);
  EXPECT_THROW(network.record_backward(commands, values, {64, {}}, {}), std::invalid_argument)
      << "a tape without gradients";
}

}  // namespace
}  // namespace arah
