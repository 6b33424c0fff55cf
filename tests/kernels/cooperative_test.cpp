// Cooperative matrices: the weights' halves on every device; the kernel where a device has what it needs, and elsewhere the reason.
#include "kernels/linear/cooperative.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "kernels/reference/half.h"
#include "kernels/reference/linear.h"
#include "tests/kernels/closeness.h"
#include "tests/kernels/device_fixture.h"
#include "tests/kernels/linear_truth.h"

namespace arah {
namespace {

class CooperativeMatrices : public DeviceTest {
 protected:
  EffectiveWeights weights(uint32_t inputs, uint32_t outputs) { return {inputs, outputs, as_doubles(uniform(size_t(inputs) * outputs)), as_doubles(uniform(outputs))}; }
};

TEST_F(CooperativeMatrices, ReadTheNearestHalvesOfTheWeights) {
  for (const auto& [inputs, outputs] : {std::pair{16u, 16u}, {64u, 64u}, {128u, 128u}, {48u, 144u}, {256u, 272u}}) {  // whole and several tiles, and wide
    const EffectiveWeights layer = weights(inputs, outputs);
    Buffer forward = filled("weights", packed_forward(layer)), halves = empty("halves", half_weights_bytes(inputs, outputs));
    record_half_weights(commands, {inputs, outputs, forward.slice(), {}, halves.slice()}, "halves");
    commands.submit_and_wait();
    const std::vector<float> biases = device.download<float>(halves.slice().elements(0, outputs));
    const std::vector<uint16_t> found = device.download<uint16_t>(halves.slice().sub(outputs * 4ull, uint64_t(inputs) * outputs * 2));
    for (size_t o = 0; o < outputs; ++o) ASSERT_EQ(biases[o], layer.b[o]) << o;
    for (size_t i = 0; i < found.size(); ++i) ASSERT_EQ(found[i], reference::half_bits(reference::nearest_half(layer.w[i]))) << i;
  }
  Buffer some = empty("some", 4096);
  EXPECT_THROW(record_half_weights(commands, {24, 16, some.slice(), {}, some.slice()}, "halves"), std::invalid_argument);
}

// On a device without the extension the kernel's place is refused with the reason; with it, its products are right.
TEST_F(CooperativeMatrices, AreRightWhereTheDeviceHasThemAndRefusedWhereNot) {
  const std::string refusal = cooperative_refusal(device);
  std::printf("  %s: %s\n", device.report().name.c_str(), refusal.empty() ? "has cooperative matrices" : refusal.c_str());
  EXPECT_EQ(refusal, device.report().cooperative_matrix_missing) << "where nothing is missing the device's own check must succeed";
  for (const auto& [inputs, outputs, points, activation, y_element] :
       {std::tuple{64u, 64u, 65u, Activation::sine, Element::half}, {256u, 256u, 130u, Activation::relu, Element::half}, {128u, 16u, 1u, Activation::none, Element::float32}}) {
    EffectiveWeights layer = weights(inputs, outputs);
    const size_t rows = padded_points(points);
    std::vector<double> x;
    std::vector<uint16_t> x_halves;
    for (const float value : uniform(rows * inputs)) {
      x_halves.push_back(reference::half_bits(reference::nearest_half(value)));
      x.push_back(reference::half_value(x_halves.back()));
    }
    Buffer x_buffer = filled("x", x_halves), forward = filled("weights", packed_forward(layer)), halves = empty("halves", half_weights_bytes(inputs, outputs)), y = empty("y", rows * outputs * 4);
    LinearForwardArgs args;
    args.x = {x_buffer.slice(), inputs, 0, Element::half};
    args.weights = {inputs, outputs, forward.slice(), {}, halves.slice()};
    args.y = {y.slice(), outputs, 0, y_element};
    args.activation = activation;
    args.range.points = points;
    if (!refusal.empty()) {
      try {
        record_linear_forward(commands, args);
        ADD_FAILURE() << "taken on a device without them";
      } catch (const CooperativeMatrixError& error) {
        EXPECT_THAT(error.what(), testing::HasSubstr(refusal));
      }
      continue;
    }
    record_half_weights(commands, args.weights, "halves");
    record_linear_forward(commands, args);
    commands.submit_and_wait();
    for (double& w : layer.w) w = reference::nearest_half(w);
    x.resize(size_t(points) * inputs);
    const std::vector<double> truth = reference::linear_forward({points, inputs, outputs}, x, layer.w, layer.b, static_cast<reference::Activation>(activation));
    std::vector<double> found;
    if (y_element == Element::half)
      for (const uint16_t bits : device.download<uint16_t>(y.slice().sub(0, size_t(points) * outputs * 2))) found.push_back(reference::half_value(bits));
    else
      found = as_doubles(device.download<float>(y.slice().elements(0, size_t(points) * outputs)));
    const double tolerance = 2e-7 * inputs + 5e-7;  // of the sums, which a device may cut off
    for (size_t i = 0; i < truth.size(); ++i) ASSERT_NEAR(found[i], truth[i], tolerance + (y_element == Element::half ? std::ldexp(std::abs(truth[i]) + tolerance, -11) : 0)) << i;
  }
}

// The check that a device must pass before its first picture finds what it should; it runs on any device, on other kernels.
TEST_F(CooperativeMatrices, TheDevicesCheckFindsWrongSums) {
  const auto float32 = [](Commands& on, LinearForwardArgs args) {
    args.weights.halves = {};
    record_linear_forward(on, args);
  };
  for (const uint32_t inputs : {16u, 64u, 256u}) {
    const CooperativeCheck right = check_cooperative(device, inputs, 64, float32);
    EXPECT_LE(right.error, right.allowed);
    // A sum that was rounded to a half, once.
    Buffer halves = empty("sums as halves", 128 * 64 * 2), identity = filled("identity", [] {
             EffectiveWeights one{64, 64, std::vector<double>(64 * 64, 0.0), std::vector<double>(64, 0.0)};
             for (size_t i = 0; i < 64; ++i) one.w[65 * i] = 1;
             return packed_forward(one);
           }());
    const CooperativeCheck rounded = check_cooperative(device, inputs, 64, [&](Commands& on, LinearForwardArgs args) {
      const Matrix result = args.y;
      args.y = {halves.slice(), 64, 0, Element::half};
      float32(on, args);
      args.x = args.y, args.y = result;
      args.weights = {64, 64, identity.slice(), {}, {}};
      float32(on, args);
    });
    const CooperativeCheck cut = check_cooperative(device, inputs, 64, [&](Commands& on, LinearForwardArgs args) {
      args.activation = Activation::relu;
      float32(on, args);
    });
    std::printf("  %u inputs: %.1e right, %.1e with sums in halves, %.1e without what is negative, %.1e allowed\n", inputs, right.error, rounded.error, cut.error, right.allowed);
    EXPECT_GT(rounded.error, rounded.allowed);
    EXPECT_GT(cut.error, cut.allowed);
  }
}

TEST_F(CooperativeMatrices, AreSwitchedOffByTheEnvironment) {
  const char* before = std::getenv("ARAH_COOPERATIVE");
  const std::string kept = before ? before : "";
  setenv("ARAH_COOPERATIVE", "off", 1);
  {
    Device without;
    EXPECT_THAT(cooperative_refusal(without), testing::HasSubstr("ARAH_COOPERATIVE=off"));
  }
  setenv("ARAH_COOPERATIVE", "fast", 1);
  EXPECT_THROW(Device(), std::invalid_argument);
  if (before) setenv("ARAH_COOPERATIVE", kept.c_str(), 1);
  else unsetenv("ARAH_COOPERATIVE");
}

}  // namespace
}  // namespace arah
