#include "kernels/reference/color.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/kernels/reference/finite_differences.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah::reference {
namespace {

using golden::expect_golden;

TEST(ViewEncoding, PutsSinesAndCosinesInOrder) {
  const std::vector<double> v = {0.3, -0.5, 0.8};
  const std::vector<double> encoding = view_encoding_forward(1, v, 4);
  ASSERT_EQ(encoding.size(), 27u);
  EXPECT_EQ(encoding[1], -0.5);
  EXPECT_EQ(encoding[3], std::sin(0.3));
  EXPECT_EQ(encoding[7], std::cos(-0.5));
  EXPECT_EQ(encoding[11], std::sin(2 * 0.8));
  EXPECT_EQ(encoding[24], std::cos(8 * 0.3));
}

// Of a body turned as a whole, canonical views and normals do not know the turn.
TEST(ColorView, IsThatOfTheCanonicalPose) {
  const double c = std::cos(0.7), s = std::sin(0.7);
  const std::vector<double> turn{c, -s, 0, s, c, 0, 0, 0, 1}, canonical{0.36, -0.48, 0.8};
  const std::vector<double> posed{c * canonical[0] - s * canonical[1], s * canonical[0] + c * canonical[1], canonical[2]};
  const std::vector<double> found = color_view(1, posed, turn, {}, {});
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(found[i], canonical[i], 1e-15);
  EXPECT_EQ(color_view(1, posed, {}, {}, {}), posed);
  // T times the result is the view again, of any blend.
  const std::vector<double> blend{0.9, 0.2, -0.1, 0.3, 0.5, 0.1, -0.2, 0, 0.7}, view = color_view(1, posed, blend, {}, {});
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR(blend[3 * i] * view[0] + blend[3 * i + 1] * view[1] + blend[3 * i + 2] * view[2], posed[i], 1e-15);
  EXPECT_EQ(color_view(1, posed, std::vector<double>{1, 0, 0, 0, 1, 0, 1, 1, 0}, {}, {}), posed) << "singular";
}

TEST(ColorView, IsRotatedWhereTheSurfaceCouldBeSeenSo) {
  const std::vector<double> quarter{0, -1, 0, 1, 0, 0, 0, 0, 1}, view{1, 0, 0, 1, 0, 0, 1, 0, 0};
  // Normals along the rotated view (0, 1, 0), against it, and across it: 90° are not seen.
  const std::vector<double> normal{0.1, 2, 0, 0.9, -0.1, 0, 1, 0, 0};
  EXPECT_EQ(color_view(3, view, {}, quarter, normal), (std::vector<double>{0, 1, 0, 1, 0, 0, 1, 0, 0}));
  // In canonical space, of the canonical normal: T turns x to y, so that both views come out turned back.
  const std::vector<double> transforms{0, -1, 0, 1, 0, 0, 0, 0, 1, 0, -1, 0, 1, 0, 0, 0, 0, 1};
  EXPECT_EQ(color_view(2, std::vector<double>{1, 0, 0, 1, 0, 0}, transforms, quarter, std::vector<double>{1, 0, 0, -1, 0, 0}),
            (std::vector<double>{1, 0, 0, 0, -1, 0}));
}

TEST(ColorView, RefusesSizesThatDoNotFit) {
  EXPECT_THROW(color_view(2, std::vector<double>(6), std::vector<double>(9), {}, {}), std::invalid_argument);
  EXPECT_THROW(color_view(2, std::vector<double>(6), {}, std::vector<double>(9), {}), std::invalid_argument);
}

// The paper's shape in small: a concatenation before the third layer, and a part of the inputs chosen by each test.
DenseNetwork small_network(std::size_t channels) {
  DenseNetwork network;
  const std::size_t outputs[] = {5, 7, 6, 3};
  std::size_t inputs = channels;
  for (std::size_t l = 0; l < 4; ++l) {
    const unsigned seed = static_cast<unsigned>(10 * l);
    DenseLayer layer;
    layer.concatenates_input = l == 2;
    layer.inputs = inputs + (l == 2 ? channels : 0);
    layer.outputs = outputs[l];
    layer.activation = l < 3 ? Activation::relu : Activation::sigmoid;
    layer.v = random_values(layer.inputs * layer.outputs, 1, seed + 1);
    layer.g = random_values(layer.outputs, 2, seed + 2);
    layer.b = random_values(layer.outputs, 0.5, seed + 3);
    inputs = layer.outputs;
    network.layers.push_back(std::move(layer));
  }
  return network;
}

void expect_color_gradients(ColorInputs inputs, std::size_t points, std::size_t channels) {
  DenseNetwork network = small_network(channels);
  const std::vector<double> weights = random_values(points * 3, 1, 77);
  const auto loss = [&] { return dot(weights, color_forward(network, points, inputs).output); };
  DenseNetwork gradients = network.zeros();
  const ColorInputs d = color_backward(network, color_forward(network, points, inputs), inputs, weights, &gradients);
  const auto compare = [&](const char* part, std::vector<double> ColorInputs::*member) {
    ASSERT_EQ((inputs.*member).size(), (d.*member).size()) << part;
    if (!(inputs.*member).empty()) expect_gradient(part, loss, inputs.*member, d.*member, 1e-5);
  };
  compare("colour x", &ColorInputs::x);
  compare("colour view", &ColorInputs::view);
  compare("colour normal", &ColorInputs::normal);
  compare("colour feature", &ColorInputs::feature);
  compare("colour latent", &ColorInputs::latent);
  compare("colour grid", &ColorInputs::grid);
  for (std::size_t l = 0; l < network.layers.size(); ++l) {
    const std::string layer = " of layer " + std::to_string(l);
    expect_gradient("colour v" + layer, loss, network.layers[l].v, gradients.layers[l].v, 1e-5);
    expect_gradient("colour g" + layer, loss, network.layers[l].g, gradients.layers[l].g, 1e-5);
    expect_gradient("colour b" + layer, loss, network.layers[l].b, gradients.layers[l].b, 1e-5);
  }
}

TEST(Color, BackwardMatchesFiniteDifferencesWithEveryInput) {
  const std::size_t n = 3;
  expect_color_gradients({random_values(n * 3, 1, 1), random_values(n * 3, 1, 2), random_values(n * 3, 1, 3),
                          random_values(n * 5, 1, 4), random_values(n * 2, 1, 5), random_values(n * 4, 1, 6)},
                         n, 3 + 27 + 3 + 5 + 2 + 4);
}

TEST(Color, BackwardMatchesFiniteDifferencesWithFewInputs) {
  expect_color_gradients({random_values(5 * 3, 1, 1), {}, {}, random_values(5 * 7, 1, 2), {}, {}}, 5, 10);
}

TEST(Color, RefusesInputsThatDoNotFit) {
  EXPECT_THROW(color_forward(small_network(10), 2, {std::vector<double>(6), {}, {}, std::vector<double>(13), {}, {}}),
               std::invalid_argument);
  EXPECT_THROW(color_forward(small_network(10), 2, {std::vector<double>(6), {}, {}, {}, {}, {}}),
               std::invalid_argument);
}

void expect_golden_case(const golden::Case& truth, const golden::Case& parameters) {
  DenseNetwork network = golden_dense(parameters, "col", Activation::relu, Activation::sigmoid);
  network.layers[3].concatenates_input = true;
  const std::size_t points = extent(truth, "in.x", 0);
  ColorInputs inputs;
  inputs.x = truth.values("in.x");
  if (truth.has("in.view")) inputs.view = truth.values("in.view");
  inputs.normal = truth.values("in.normal");
  inputs.feature = truth.values("in.z");
  const std::vector<double> latent = truth.values("in.Z");
  for (std::size_t p = 0; p < points; ++p) inputs.latent.insert(inputs.latent.end(), latent.begin(), latent.end());

  const DenseTape tape = color_forward(network, points, inputs);
  expect_golden(truth, "out.rgb", tape.output);
  const std::vector<double> weights = truth.values("in.G");
  expect_golden(truth, "out.L", dot(weights, tape.output));
  DenseNetwork gradients = network.zeros();
  const ColorInputs d = color_backward(network, tape, inputs, weights, &gradients);
  expect_golden(truth, "grad.x", d.x);
  if (truth.has("in.view")) expect_golden(truth, "grad.view", d.view);
  expect_golden(truth, "grad.normal", d.normal);
  expect_golden(truth, "grad.z", d.feature);
  std::vector<double> d_latent(latent.size(), 0.0);  // one code, shared by all points
  for (std::size_t i = 0; i < d.latent.size(); ++i) d_latent[i % latent.size()] += d.latent[i];
  expect_golden(truth, "grad.Z", d_latent);
  expect_golden_dense(truth, "col", gradients);
}

TEST(Color, MatchesTheGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  expect_golden_case(golden::Case("06_colour"), golden::Case("06_colour_params"));
}

TEST(Color, MatchesTheGoldenCaseWithoutView) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("06_colour_noview");
  expect_golden_case(truth, truth);
}

}  // namespace
}  // namespace arah::reference
