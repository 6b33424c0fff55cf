// The sine and cosine of shaders/lib/sine.glsl, through a linear layer whose weights are the identity.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "kernels/linear/linear.h"
#include "tests/kernels/device_fixture.h"
#include "tests/kernels/linear_truth.h"

namespace arah {
namespace {

constexpr uint32_t points = 1024, channels = 8;

class SineTest : public DeviceTest {
 protected:
  // values: [points * channels]. Products with 0 and 1 are exact, so the layer's sine has just these arguments.
  void run(const std::vector<float>& values) {
    EffectiveWeights identity{channels, channels, std::vector<double>(channels * channels), std::vector<double>(channels)};
    for (size_t i = 0; i < channels; ++i) identity.w[i * channels + i] = 1;
    Buffer x = filled("angles", values), w = filled("identity", packed_forward(identity)),
           y = empty("sines", values.size() * 4), c = empty("cosines", values.size() * 4);
    LinearForwardArgs args;
    args.x = {x.slice(), channels, 0};
    args.weights = {channels, channels, w.slice(), {}};
    args.y = {y.slice(), channels, 0};
    args.activation = Activation::sine;
    args.cosine = {c.slice(), channels, 0};
    args.range.points = points;
    record_linear_forward(commands, args);
    commands.submit_and_wait();
    sines = device.download<float>(y.slice());
    cosines = device.download<float>(c.slice());
  }
  void expect_close(const std::vector<float>& values) {
    double sine_error = 0, cosine_error = 0;
    for (size_t i = 0; i < values.size(); ++i) {
      // not std::max alone, which would pass over a NaN
      ASSERT_TRUE(std::isfinite(sines[i]) && std::isfinite(cosines[i])) << values[i];
      sine_error = std::max(sine_error, std::abs(sines[i] - std::sin(double(values[i]))));
      cosine_error = std::max(cosine_error, std::abs(cosines[i] - std::cos(double(values[i]))));
    }
    EXPECT_LE(sine_error, 2e-7);
    EXPECT_LE(cosine_error, 2e-7);
    RecordProperty("sine_error", std::to_string(sine_error * 1e7) + "e-7");
    RecordProperty("cosine_error", std::to_string(cosine_error * 1e7) + "e-7");
  }

  std::vector<float> sines, cosines;
};

TEST_F(SineTest, IsWithinTwoTenMillionthsUpToTenThousand) {
  for (const double range : {1.0, 30.0, 200.0, 1e4}) {
    SCOPED_TRACE(range);
    const std::vector<float> values = uniform(points * channels, -range, range);
    run(values);
    expect_close(values);
  }
}

// Where the reduction cancels most, and where its parity changes: next to the multiples of π/2.
TEST_F(SineTest, IsAsCloseNextToMultiplesOfHalfPi) {
  std::vector<float> values;
  for (int i = 0; values.size() < points * channels; ++i) {
    const int multiple = i < 400 ? i : i * 5;  // up to 6,300 and so beyond 9,000
    for (const double sign : {-1.0, 1.0}) {
      const float nearest = static_cast<float>(sign * multiple * std::numbers::pi / 2);
      values.push_back(nearest);
      values.push_back(std::nextafter(nearest, 1e9F));
    }
  }
  values.resize(points * channels);
  ASSERT_GT(*std::max_element(values.begin(), values.end()), 9000);
  run(values);
  expect_close(values);
}

// Weights of zero times infinity are NaN, so each point has one kind of number in all its channels.
TEST_F(SineTest, NumbersThatAreNotFiniteGiveNan) {
  std::vector<float> values(points * channels, 0.5F);
  const float specials[] = {std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity(),
                            std::numeric_limits<float>::quiet_NaN()};
  for (size_t s = 0; s < 3; ++s) std::fill_n(values.begin() + static_cast<long>(s * channels), channels, specials[s]);
  run(values);
  for (size_t i = 0; i < 3 * channels; ++i) EXPECT_TRUE(std::isnan(sines[i]) && std::isnan(cosines[i])) << i;
  for (size_t i = 3 * channels; i < values.size(); ++i) ASSERT_NEAR(sines[i], std::sin(0.5), 1e-7);
}

}  // namespace
}  // namespace arah
