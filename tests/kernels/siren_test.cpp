// The SIREN on the device: golden cases, and random networks against the double-precision truth.
#include "kernels/sdf/siren.h"

#include <gtest/gtest.h>

#include <cmath>

#include "kernels/reference/half.h"
#include "kernels/reference/linear.h"
#include "shaders/shared/work_count.h"
#include "tests/golden_tolerance.h"
#include "tests/kernels/device_networks.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah {
namespace {

using golden::expect_golden_float;

// Of the largest number: the float32 reference itself is up to 7e-6 away from the truth in the golden cases.
constexpr double tolerance = 1e-5;

class SirenTest : public DeviceTest {
 protected:
  std::vector<double> numbers(size_t count, double range, double center = 0) {
    const std::vector<float> values = uniform(count, center - range, center + range);
    return {values.begin(), values.end()};
  }

  // Weights that keep the phases of all layers of order 1 to 10. Without FiLM: gamma 1, eta 0.
  reference::Siren random_siren(const SirenShape& shape) {
    reference::Siren siren;
    siren.omega = shape.omega;
    for (uint32_t l = 0; l <= shape.sine_layers; ++l) {
      const bool sine = l < shape.sine_layers;
      reference::SirenLayer layer{l == 0 ? 3 : shape.width, sine ? shape.width : 1, {}, {}, {}, {}};
      layer.w = numbers(layer.inputs * layer.outputs, l == 0 ? 1.0 / 3 : std::sqrt(6.0 / shape.width) / shape.omega);
      layer.b = numbers(layer.outputs, 0.1);
      if (sine) {
        layer.gamma = shape.film ? numbers(shape.width, 0.3, 1) : std::vector<double>(shape.width, 1.0);
        layer.eta = shape.film ? numbers(shape.width, 0.1) : std::vector<double>(shape.width, 0.0);
      }
      siren.layers.push_back(std::move(layer));
    }
    return siren;
  }
};

// Against "<kind>.sdf.*" where stored, else the 2-norm against "<kind>_norm.sdf.*".
void expect_golden_gradients(const golden::Case& truth, const std::string& kind, const std::vector<RawLayer>& gradients,
                             const std::vector<double>& d_x) {
  const auto compare = [&](const std::string& tensor, const std::vector<double>& values) {
    if (truth.has(kind + "." + tensor)) return expect_golden_float(truth, kind + "." + tensor, values);
    double squares = 0;
    for (double value : values) squares += value * value;
    expect_golden_float(truth, kind + "_norm." + tensor, std::vector<double>{std::sqrt(squares)});
  };
  compare("x", d_x);
  static const char* const parts[] = {"W", "b", "gamma", "eta"};
  for (size_t l = 0; l < gradients.size(); ++l)
    for (size_t t = 0; t < 4; ++t)
      if (!gradients[l][t].empty()) compare("sdf." + std::to_string(l) + "." + parts[t], gradients[l][t]);
}

void expect_golden_case(Device& device, Commands& commands, const golden::Case& truth, const golden::Case& parameters) {
  const uint32_t points = static_cast<uint32_t>(truth.extent("in.x", 0));
  DeviceSiren on(device, reference::golden_siren(parameters), true, points, SirenTape::Holds::second_order);
  const reference::SirenAdjoint adjoint{truth.values("in.Ga"), truth.values("in.Gz"), truth.values("in.Gn")};
  write_rows(device, on.tape.input(), 8, truth.values("in.x"), points);
  on.write_cotangents(adjoint, points);
  Siren::Backward backward;
  backward.feature = backward.gradient = backward.input_gradient = true;
  backward.scratch = on.scratch.slice();
  on.siren.record_pack(commands);
  on.siren.record_forward(commands, on.tape, {points, {}}, true);
  on.siren.record_gradient(commands, on.tape, {points, {}}, true);
  on.siren.record_backward(commands, on.tape, {points, {}}, backward);
  on.siren.record_unpack(commands);
  commands.submit_and_wait();

  const std::vector<double> gradient = on.gradient(points);
  expect_golden_float(truth, "out.f", on.sdf(points));
  expect_golden_float(truth, "out.z", on.feature(points));
  expect_golden_float(truth, "out.grad", gradient);
  expect_golden_gradients(truth, "grad", on.tensors.download_gradients(), on.input_gradient(points));

  // E = Σ | |n| − 1 |, so dE/dn = sign(|n| − 1) n/|n|; the value and the feature do not enter
  reference::SirenAdjoint eikonal{std::vector<double>(points, 0.0), {}, gradient};
  double sum = 0;
  for (uint32_t p = 0; p < points; ++p) {
    double* n = eikonal.gradient.data() + size_t(p) * 3;
    const double length = std::hypot(n[0], n[1], n[2]);
    sum += std::abs(length - 1);
    for (int i = 0; i < 3; ++i) n[i] *= (length > 1 ? 1 : -1) / length;
  }
  expect_golden_float(truth, "out.E", std::vector<double>{sum});
  on.tensors.clear_gradients();
  on.write_cotangents(eikonal, points);
  backward.feature = false;
  on.siren.record_backward(commands, on.tape, {points, {}}, backward);
  on.siren.record_unpack(commands);
  commands.submit_and_wait();
  expect_golden_gradients(truth, "gradE", on.tensors.download_gradients(), on.input_gradient(points));
}

TEST_F(SirenTest, MatchesTheSmallGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("04_siren_small");
  expect_golden_case(device, commands, truth, truth);
}

TEST_F(SirenTest, MatchesTheFullGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  expect_golden_case(device, commands, golden::Case("04_siren_full"), golden::Case("04_siren_full_params"));
}

struct RandomCase {
  const char* name;
  SirenShape shape;
  uint32_t points, capacity;
  bool feature, gradient, accumulate, input_gradient;
};

class RandomSiren : public SirenTest, public testing::WithParamInterface<RandomCase> {};

TEST_P(RandomSiren, MatchesTheTruth) {
  const RandomCase& c = GetParam();
  const uint32_t points = c.points;
  const reference::Siren truth = random_siren(c.shape);
  DeviceSiren on(device, truth, c.shape.film, c.capacity,
                 c.gradient ? SirenTape::Holds::second_order : SirenTape::Holds::first_order);
  const std::vector<double> x = numbers(points * 3, 1);
  // What is switched off lies in the tape all the same, and must not be read.
  const reference::SirenAdjoint given{numbers(points, 1), numbers(points * c.shape.width, 1),
                                      c.gradient ? numbers(points * 3, 0.1) : std::vector<double>{}};
  write_rows(device, on.tape.input(), 8, x, points);
  on.write_cotangents(given, points);

  Siren::Backward backward;
  backward.feature = c.feature;
  backward.gradient = c.gradient;
  backward.input_gradient = c.input_gradient;
  backward.scratch = on.scratch.slice();
  const PointRange range{points, {}};
  on.siren.record_pack(commands);
  on.siren.record_forward(commands, on.tape, range, true);
  on.siren.record_gradient(commands, on.tape, range, c.gradient);
  on.siren.record_backward(commands, on.tape, range, backward);
  on.siren.record_backward(commands, on.tape, range, backward);  // replaces the effective gradients
  if (c.accumulate) {                                            // doubles them
    backward.accumulate = true;
    on.siren.record_backward(commands, on.tape, range, backward);
  }
  on.siren.record_unpack(commands);
  on.siren.record_unpack(commands);  // doubles the raw gradients
  commands.submit_and_wait();

  const reference::SirenOutput output = reference::siren_forward(truth, points, x);
  reference::Siren gradients = truth.zeros();
  const std::vector<double> d_x = reference::siren_backward(
      truth, points, x, {given.sdf, c.feature ? given.feature : std::vector<double>{}, given.gradient}, gradients);
  expect_near("sdf", on.sdf(points), output.sdf, tolerance);
  expect_near("feature", on.feature(points), output.feature, tolerance);
  expect_near("gradient", on.gradient(points), output.gradient, tolerance);
  expect_near("d", on.tensors.download_gradients(), raw_layers(gradients, c.shape.film), c.accumulate ? 4 : 2,
              tolerance);
  const std::vector<double> found = on.input_gradient(points);
  if (c.input_gradient)
    expect_near("d input", found, d_x, tolerance);
  else
    EXPECT_EQ(found, std::vector<double>(points * 3, 0.0));
}

SirenShape siren_shape(uint32_t width, uint32_t sine_layers, float omega, bool film) {
  return {width, sine_layers, omega, film};
}

INSTANTIATE_TEST_SUITE_P(
    Shapes, RandomSiren,
    testing::Values(RandomCase{"EverythingOneLayer", siren_shape(24, 1, 30, true), 65, 65, true, true, true, true},
                    RandomCase{"Everything", siren_shape(24, 3, 30, true), 63, 200, true, true, false, true},
                    RandomCase{"NoFilm", siren_shape(24, 3, 30, false), 65, 200, true, true, true, true},
                    RandomCase{"PaddedWidth", siren_shape(20, 2, 30, true), 65, 65, true, true, false, true},
                    RandomCase{"OtherFrequency", siren_shape(24, 2, 7.5f, true), 1, 1, false, true, false, true},
                    RandomCase{"NoGradientCotangent", siren_shape(24, 2, 30, true), 65, 130, true, false, true, true},
                    RandomCase{"NoFeatureCotangent", siren_shape(24, 2, 30, false), 65, 65, false, true, true, false},
                    RandomCase{"ValueOnly", siren_shape(24, 3, 30, true), 1000, 1000, false, false, false, false}),
    [](const testing::TestParamInfo<RandomCase>& test) { return std::string(test.param.name); });

TEST_F(SirenTest, KeepsNothingWithoutChangingItsValues) {
  const uint32_t points = 65;
  SirenShape shape{24, 2, 30, true};
  const reference::Siren truth = random_siren(shape);
  DeviceSiren kept(device, truth, true, points, SirenTape::Holds::first_order);
  SirenTape bare(device, "bare", shape, points, SirenTape::Holds::values);
  const std::vector<double> x = numbers(points * 3, 1);
  write_rows(device, kept.tape.input(), 8, x, points);
  write_rows(device, bare.input(), 8, x, points);
  kept.siren.record_pack(commands);
  kept.siren.record_forward(commands, kept.tape, {points, {}}, true);
  kept.siren.record_forward(commands, bare, {points, {}}, false);
  commands.submit_and_wait();
  EXPECT_EQ(kept.sdf(points), read_rows(device, bare.sdf(), points, 1));
  EXPECT_EQ(kept.feature(points), read_rows(device, bare.feature(), points, 24));
}

TEST_F(SirenTest, TakesTheNumberOfPointsFromTheDevice) {
  const uint32_t points = 65, capacity = 192;  // two groups of three
  const reference::Siren truth = random_siren({24, 2, 30, true});
  DeviceSiren on(device, truth, true, capacity, SirenTape::Holds::first_order);
  const std::vector<double> x = numbers(capacity * 3, 1);
  write_rows(device, on.tape.input(), 8, x, capacity);
  Buffer count = filled("count", std::vector<WorkCount>{{2, 1, 1, points}});
  const PointRange range{capacity, count.slice()};
  on.siren.record_pack(commands);
  on.siren.record_forward(commands, on.tape, range, true);
  on.siren.record_gradient(commands, on.tape, range, false);
  commands.submit_and_wait();
  const reference::SirenOutput output = reference::siren_forward(truth, capacity, x);
  expect_near("sdf", on.sdf(128), {output.sdf.begin(), output.sdf.begin() + 128}, tolerance);
  expect_near("gradient", on.gradient(128), {output.gradient.begin(), output.gradient.begin() + 128 * 3}, tolerance);
  const std::vector<double> all = on.sdf(capacity);
  EXPECT_EQ(std::vector<double>(all.begin() + 128, all.end()), std::vector<double>(64, 0.0))
      << "the third group must not run";
}

TEST_F(SirenTest, RefusesATapeThatDoesNotHoldEnough) {
  const reference::Siren truth = random_siren({24, 2, 30, true});
  DeviceSiren on(device, truth, true, 64, SirenTape::Holds::first_order);
  SirenTape bare(device, "bare", on.shape, 64, SirenTape::Holds::values);
  Siren::Backward backward;
  backward.scratch = on.scratch.slice();
  EXPECT_THROW(on.siren.record_forward(commands, bare, {64, {}}, true), std::invalid_argument);
  EXPECT_THROW(on.siren.record_gradient(commands, bare, {64, {}}, false), std::invalid_argument);
  EXPECT_THROW(on.siren.record_backward(commands, bare, {64, {}}, backward), std::invalid_argument);
  EXPECT_THROW(on.siren.record_gradient(commands, on.tape, {64, {}}, true), std::invalid_argument);
  backward.gradient = true;
  EXPECT_THROW(on.siren.record_backward(commands, on.tape, {64, {}}, backward), std::invalid_argument);
  backward.gradient = false;
  EXPECT_THROW(on.siren.record_backward(commands, on.tape, {65, {}}, backward), std::invalid_argument)
      << "more points than rows";
}

// Halves between the layers: nearer to a truth that rounds the same sines than that one is to the exact truth.
TEST_F(SirenTest, KeepsItsSinesAsHalvesWhereTold) {
  const SirenShape shape{72, 3, 30, true};
  const uint32_t points = 500;
  const reference::Siren truth = random_siren(shape);
  const std::vector<double> x = numbers(points * 3, 0.8);
  DeviceSiren on(device, truth, true, points, SirenTape::Holds::first_order);
  SirenTape values(device, "values", shape, points, SirenTape::Holds::values, Element::half, false), with_feature(device, "with a feature", shape, points, SirenTape::Holds::values, Element::half), shaded(device, "shaded", shape, points, SirenTape::Holds::first_order, Element::half);
  on.siren.record_pack(commands);
  for (SirenTape* tape : {&values, &with_feature, &shaded}) {
    write_rows(device, tape->input(), 8, x, points);
    on.siren.record_forward(commands, *tape, {points, {}}, tape == &shaded);
  }
  on.siren.record_gradient(commands, shaded, {points, {}}, false);
  commands.submit_and_wait();
  const std::vector<double> found = read_rows(device, values.sdf(), points, 1), feature = read_rows(device, shaded.feature(), points, shape.width), gradient = read_rows(device, shaded.gradient(), points, 3);

  const reference::SirenOutput exact = reference::siren_forward(truth, points, x);
  std::vector<double> h = x;
  for (const reference::SirenLayer& layer : truth.layers) {
    h = reference::linear_pre_activation({points, layer.inputs, layer.outputs}, h, layer.w, layer.b);
    if (layer.gamma.empty()) break;
    for (size_t i = 0; i < h.size(); ++i) h[i] = reference::nearest_half(std::sin(truth.omega * (layer.gamma[i % layer.outputs] * h[i] + layer.eta[i % layer.outputs])));
  }
  const auto difference = [](const std::vector<double>& a, const std::vector<double>& b) {
    double squares = 0;
    for (size_t i = 0; i < a.size(); ++i) squares += (a[i] - b[i]) * (a[i] - b[i]);
    return std::sqrt(squares / double(a.size()));
  };
  std::printf("  mean difference of squares: distance %.2e from the rounding truth, %.2e from the exact one; feature %.2e, gradient %.2e of %.2f\n", difference(found, h), difference(found, exact.sdf), difference(feature, exact.feature),
              difference(gradient, exact.gradient), difference(exact.gradient, std::vector<double>(exact.gradient.size())));
  EXPECT_EQ(read_rows(device, with_feature.feature(), points, shape.width), feature);
  EXPECT_LT(difference(found, h), 0.25 * difference(h, exact.sdf));
  EXPECT_LT(difference(feature, exact.feature), 5e-4);  // the unit of halves near 1

  EXPECT_THROW(values.feature(), std::logic_error) << "float32 alone is read outside of the network";
  Siren::Backward backward;
  backward.scratch = on.scratch.slice();
  EXPECT_THROW(on.siren.record_backward(commands, shaded, {points, {}}, backward), std::invalid_argument);
}

}  // namespace
}  // namespace arah
