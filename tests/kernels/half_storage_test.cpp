// Linear layers whose rows are stored as halves, in both families and all kernels: against a double-precision truth that
// rounds at the same places, and against the truth without any rounding.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "kernels/reference/half.h"
#include "kernels/reference/linear.h"
#include "tests/kernels/closeness.h"
#include "tests/kernels/device_fixture.h"
#include "tests/kernels/linear_truth.h"

namespace arah {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
const double unit = std::ldexp(1.0, -11);         // relative error of the nearest half
const double least_spacing = std::ldexp(1.0, -24);  // of halves, below 2^-14

// Rows with columns on both sides that do not belong to them.
struct Rows {
  Buffer buffer;
  uint32_t points, channels, stride;
  Element element;
  Matrix matrix() { return {buffer.slice(), stride, 8, element}; }
};

struct Case {
  LinearFamily family;
  Activation activation;
  uint32_t inputs, outputs, points;
  Element x, y;
};
void PrintTo(const Case& c, std::ostream* out) {
  const auto name = [](Element element) { return element == Element::half ? "half" : "float"; };
  *out << (c.family == LinearFamily::tiled ? "tiled" : "straight") << ", activation " << static_cast<int>(c.activation) << ", " << c.inputs << " to " << c.outputs << ", " << c.points << " points, " << name(c.x) << " to " << name(c.y);
}

class HalfStorage : public DeviceTest {
 protected:
  // Channels of all padded points: `values`, or NaN where there are none.
  Rows rows(Element element, uint32_t points, uint32_t channels, const std::vector<float>& values = {}) {
    const uint32_t stride = channels + 16;
    std::vector<float> all(size_t(padded_points(points)) * stride, nan);
    if (!values.empty())
      for (uint32_t p = 0; p < padded_points(points); ++p)
        for (uint32_t c = 0; c < channels; ++c) all[size_t(p) * stride + 8 + c] = values.at(size_t(p) * channels + c);
    if (element == Element::float32) return {filled("rows", all), points, channels, stride, element};
    std::vector<uint16_t> halves;
    for (const float value : all) halves.push_back(reference::half_bits(reference::nearest_half(value)));
    return {filled("rows of halves", halves), points, channels, stride, element};
  }

  // The real rows; the columns beside must be untouched.
  std::vector<double> result(Rows& found) {
    std::vector<double> all;
    if (found.element == Element::half)
      for (const uint16_t bits : device.download<uint16_t>(found.buffer.slice())) all.push_back(reference::half_value(bits));
    else
      for (const float value : device.download<float>(found.buffer.slice())) all.push_back(value);
    std::vector<double> values;
    for (uint32_t p = 0; p < found.points; ++p)
      for (uint32_t c = 0; c < found.stride; ++c) {
        const double value = all[size_t(p) * found.stride + c];
        if (c >= 8 && c < 8 + found.channels) values.push_back(value);
        else EXPECT_TRUE(std::isnan(value)) << "column " << c << " is not the kernel's";
      }
    return values;
  }

  void run(const Case& c, Rows& x, const EffectiveWeights& layer, Rows& y) {
    Buffer forward = filled("weights", packed_forward(layer));
    LinearForwardArgs args;
    args.x = x.matrix();
    args.weights = {c.inputs, c.outputs, forward.slice(), {}};
    args.y = y.matrix();
    args.activation = c.activation;
    args.range.points = c.points;
    args.family = c.family;
    record_linear_forward(commands, args);
    commands.submit_and_wait();
  }
};

// Rounding of a sum of `terms` products of numbers up to 1 in size, in any order, and of the activation.
double sum_tolerance(uint32_t terms) { return 1e-7 * terms + 5e-7; }

class HalfStorageCases : public HalfStorage, public testing::WithParamInterface<Case> {};

TEST_P(HalfStorageCases, MatchTheTruth) {
  const Case c = GetParam();
  const std::vector<float> x_values = uniform(size_t(padded_points(c.points)) * c.inputs);
  const EffectiveWeights layer{c.inputs, c.outputs, as_doubles(uniform(size_t(c.inputs) * c.outputs)), as_doubles(uniform(c.outputs))};
  Rows x = rows(c.x, c.points, c.inputs, x_values), y = rows(c.y, c.points, c.outputs);
  run(c, x, layer, y);
  const std::vector<double> found = result(y);

  const reference::LinearShape shape{c.points, c.inputs, c.outputs};
  const std::vector<double> exact_x(x_values.begin(), x_values.begin() + long(c.points) * c.inputs);
  std::vector<double> stored_x = exact_x;
  if (c.x == Element::half)
    for (double& value : stored_x) value = reference::nearest_half(value);
  const auto activation = static_cast<reference::Activation>(c.activation);
  const std::vector<double> rounded = reference::linear_forward(shape, stored_x, layer.w, layer.b, activation), exact = reference::linear_forward(shape, exact_x, layer.w, layer.b, activation);
  ASSERT_EQ(found.size(), rounded.size());

  // Of the input's errors, the most that any output can collect: no activation here is steeper than 1.
  std::vector<double> collected(exact.size(), 0.0);
  for (uint32_t p = 0; p < c.points; ++p)
    for (uint32_t i = 0; i < c.inputs; ++i)
      for (uint32_t o = 0; o < c.outputs; ++o) collected[size_t(p) * c.outputs + o] += std::abs(layer.w[size_t(i) * c.outputs + o]) * (unit * std::abs(exact_x[size_t(p) * c.inputs + i]) + 0.5 * least_spacing);

  const double tolerance = sum_tolerance(c.inputs);
  double from_rounded = 0, from_exact = 0;
  for (size_t i = 0; i < found.size(); ++i) {
    // Whatever a float32 sum may be off by, the half that it is rounded to lies between these.
    double low = rounded[i] - tolerance, high = rounded[i] + tolerance;
    if (c.y == Element::half) low = reference::nearest_half(low), high = reference::nearest_half(high);
    EXPECT_GE(found[i], low) << i;
    EXPECT_LE(found[i], high) << i;
    EXPECT_LE(std::abs(found[i] - exact[i]), tolerance + (c.x == Element::half ? collected[i] : 0) + (c.y == Element::half ? unit * (std::abs(exact[i]) + collected[i]) + 0.5 * least_spacing : 0)) << i;
    from_rounded = std::max(from_rounded, std::abs(found[i] - rounded[i]));
    from_exact = std::max(from_exact, std::abs(found[i] - exact[i]));
    if (HasFailure()) break;
  }
  std::printf("  largest difference %.2e from the truth that rounds its input, %.2e from the one that rounds nothing\n", from_rounded, from_exact);
}

std::vector<Case> cases() {
  constexpr Element half = Element::half, full = Element::float32;
  std::vector<Case> all;
  for (const LinearFamily family : {LinearFamily::straight, LinearFamily::tiled})
    for (const auto& [activation, inputs, outputs, points, x, y] : std::initializer_list<std::tuple<Activation, uint32_t, uint32_t, uint32_t, Element, Element>>{
             {Activation::none, 8, 8, 1, half, half},
             {Activation::sine, 8, 64, 63, full, half},  // a first layer
             {Activation::sine, 64, 64, 64, half, half},
             {Activation::sine, 64, 8, 65, half, full},  // a last one
             {Activation::relu, 40, 72, 65, half, half},
             {Activation::softplus, 24, 16, 1, half, half},
             {Activation::sigmoid, 128, 8, 64, half, full},
             {Activation::leaky_relu, 136, 72, 65, half, half},  // from here on wide
             {Activation::sine, 256, 256, 63, half, half},
             {Activation::sine, 136, 256, 1, full, half},
             {Activation::relu, 264, 136, 65, half, full}})
      all.push_back({family, activation, inputs, outputs, points, x, y});
  return all;
}
INSTANTIATE_TEST_SUITE_P(Kernels, HalfStorageCases, testing::ValuesIn(cases()));

// Through a layer that changes nothing, into halves and back.
TEST_F(HalfStorage, ExtremesComeOutAsTheFormatSays) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  const std::vector<float> numbers{0, 1, -1, 1 + 0x1p-11f, 1 + 3 * 0x1p-11f, -1 - 0x1.002p-11f, 65504, 65519, 65520, -65520, 1e9f, -3e38f, 0x1p-14f, -0x1.ff8p-14f, 0x1.8p-15f, -0x1p-24f, 0x1.8p-24f, 0x1p-25f, 1e-30f, infinity, -infinity};
  const uint32_t points = static_cast<uint32_t>(numbers.size());
  for (const LinearFamily family : {LinearFamily::straight, LinearFamily::tiled}) {
    Case c{family, Activation::none, 8, 8, points, Element::float32, Element::half};
    EffectiveWeights layer{8, 8, std::vector<double>(64, 0.0), std::vector<double>(8, 0.0)};
    layer.w[0] = 1;
    std::vector<float> x(size_t(padded_points(points)) * 8, 0.0f);
    for (size_t i = 0; i < numbers.size(); ++i) x[8 * i] = numbers[i];
    Rows from = rows(Element::float32, points, 8, x), to = rows(Element::half, points, 8);
    run(c, from, layer, to);
    const std::vector<double> found = result(to);
    for (size_t i = 0; i < numbers.size(); ++i) EXPECT_EQ(found[8 * i], reference::nearest_half(numbers[i])) << numbers[i];
    // and out again, but for the infinities, which the products with 0 make NaN
    Rows again = rows(Element::float32, points, 8);
    c.x = Element::half, c.y = Element::float32;
    run(c, to, layer, again);
    const std::vector<double> back = result(again);
    for (size_t i = 0; i < numbers.size(); ++i) {
      if (std::isfinite(numbers[i])) EXPECT_NEAR(back[8 * i], found[8 * i], std::abs(found[8 * i]) < 0x1p-14 ? std::abs(found[8 * i]) : 0) << numbers[i] << ": only below 2^-14 may it be 0";
      else EXPECT_FALSE(std::isfinite(back[8 * i])) << "what is not finite is not lost";
    }
  }
}

TEST_F(HalfStorage, NaNStaysNaN) {
  for (const LinearFamily family : {LinearFamily::straight, LinearFamily::tiled}) {
    const EffectiveWeights layer{8, 8, std::vector<double>(64, 1.0), std::vector<double>(8, 0.0)};
    std::vector<float> x(512, 0.0f);
    x[0] = nan;
    Rows from = rows(Element::float32, 2, 8, x), to = rows(Element::half, 2, 8), last = rows(Element::float32, 2, 8);
    run({family, Activation::none, 8, 8, 2, Element::float32, Element::half}, from, layer, to);
    run({family, Activation::none, 8, 8, 2, Element::half, Element::float32}, to, layer, last);
    const std::vector<double> found = result(last);
    for (uint32_t c = 0; c < 8; ++c) {
      EXPECT_TRUE(std::isnan(found[c]));
      EXPECT_EQ(found[8 + c], 0.0);
    }
  }
}

// What only training does takes float32, and says so.
TEST_F(HalfStorage, TheWayBackIsRefused) {
  Rows halves = rows(Element::half, 64, 16), floats = rows(Element::float32, 64, 16);
  Buffer weights = filled("weights", std::vector<float>(packed_floats(16, 16)));
  LinearInputGradientArgs input;
  input.dy = floats.matrix();
  input.weights = {16, 16, weights.slice(), weights.slice()};
  input.result = floats.matrix();
  input.activation_below = Activation::relu;
  input.stored = halves.matrix();
  input.range.points = 64;
  EXPECT_THROW(record_linear_input_gradient(commands, input), std::invalid_argument);
  input.stored = floats.matrix();
  input.result = halves.matrix();
  EXPECT_THROW(record_linear_input_gradient(commands, input), std::invalid_argument);
  LinearWeightGradientArgs weight;
  weight.x = halves.matrix();
  weight.dy = floats.matrix();
  weight.inputs = weight.outputs = 16;
  weight.points = 64;
  EXPECT_THROW(record_linear_weight_gradient(commands, weight), std::invalid_argument);
  EXPECT_THROW(record_activation_gradient(commands, {floats.matrix(), halves.matrix(), floats.matrix(), Activation::relu, 16, 64}), std::invalid_argument);
  LinearForwardArgs forward;
  forward.x = floats.matrix();
  forward.weights = input.weights;
  forward.y = floats.matrix();
  forward.activation = Activation::sine;
  forward.cosine = halves.matrix();
  forward.range.points = 64;
  EXPECT_THROW(record_linear_forward(commands, forward), std::invalid_argument) << "cosines are of the way back";
}

}  // namespace
}  // namespace arah
