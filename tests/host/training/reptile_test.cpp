// Reptile's outer step against what paper and pencil say, on points that are pulled to places of their own.
#include "host/training/reptile.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "host/input_error.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

// Loss of task k: ½ |p − c_k|² over 64 parameters that all start at `start`, so the gradient is p − c_k.
class ReptileTest : public DeviceTest {
 protected:
  static constexpr uint64_t count = 64;
  Buffer parameters = filled("parameters", std::vector<float>(3 * count, 0.5F)), gradients = empty("gradients", 3 * count * 4);

  std::vector<ReptileGroup> group(double inner_rate, double outer_rate) { return {{"sdf", count, 2 * count, inner_rate, outer_rate}}; }
  Reptile::TaskGradients pull(std::vector<float> centers) {
    return [this, centers](Commands& pending, std::size_t task, uint32_t) {
      pending.submit_and_wait();  // what cleared the gradients
      std::vector<float> g = device.download<float>(parameters.slice());
      for (float& x : g) x -= centers[task];
      device.upload(gradients.slice(), g);
    };
  }
  std::vector<float> values() { return device.download<float>(parameters.slice()); }
};

// Plain Adam as in its paper, in double precision, on one number.
struct ScalarAdam {
  double m = 0, v = 0;
  int t = 0;
  double step(double p, double g, double rate) {
    ++t;
    m = 0.9 * m + 0.1 * g;
    v = 0.999 * v + 0.001 * g * g;
    return p - rate * (m / (1 - std::pow(0.9, t))) / (std::sqrt(v / (1 - std::pow(0.999, t))) + 1e-8);
  }
};

TEST_F(ReptileTest, AnOuterStepIsAdamOnTheMeanOfStartMinusEnd) {
  const double inner_rate = 0.02, outer_rate = 0.01;
  const std::vector<float> centers{0.6F, 2.0F, -0.1F};
  constexpr uint32_t inner_steps = 7;
  Reptile reptile(device, parameters.slice(), gradients.slice(), group(inner_rate, outer_rate), inner_steps);
  double truth = 0.5;
  ScalarAdam outer;
  const std::vector<std::array<std::size_t, 2>> batches{{0, 1}, {2, 1}, {0, 2}, {1, 0}};
  for (const auto& batch : batches) {
    double direction = 0;
    for (const std::size_t task : batch) {
      double p = truth;
      ScalarAdam inner;
      for (uint32_t i = 0; i < inner_steps; ++i) p = inner.step(p, p - double{centers[task]}, inner_rate);
      direction += (truth - p) / 2;
    }
    truth = outer.step(truth, direction, outer_rate);
    reptile.step(batch, pull(centers));
    const std::vector<float> found = values();
    for (uint64_t i = 0; i < 3 * count; ++i)
      if (i < count || i >= 2 * count) EXPECT_EQ(found[i], 0.5F) << "of no group";
      else ASSERT_NEAR(found[i], truth, 2e-6) << "step " << reptile.steps();
  }
  EXPECT_EQ(reptile.steps(), batches.size());
  EXPECT_GT(std::abs(truth - 0.5), 0.01);
}

// By hand: far from its place, Adam's first steps are one rate long each, whatever the gradient's size; two tasks that pull
// apart alike cancel, and one that pulls alone moves the outer step by its rate.
TEST_F(ReptileTest, TasksThatPullApartCancel) {
  Reptile reptile(device, parameters.slice(), gradients.slice(), group(1e-4, 1e-2), 1);
  device.upload(parameters.slice(), std::vector<float>(3 * count, 0.0F));  // float rounds alike on both sides
  const std::array<std::size_t, 2> both{0, 1};
  reptile.step(both, pull({10.0F, -10.0F}));
  EXPECT_EQ(values()[count], 0.0F);
  Reptile alone(device, parameters.slice(), gradients.slice(), group(1e-4, 1e-2), 24);
  const std::array<std::size_t, 1> one{0};
  alone.step(one, pull({10.0F, -10.0F}));
  EXPECT_NEAR(values()[count], 0.01F, 1e-6F);
}

TEST_F(ReptileTest, ContinuesBitForBitAndRefusesWhatDoesNotFit) {
  const std::vector<float> centers{0.6F, 2.0F, -0.1F};
  const std::array<std::size_t, 2> batch{0, 1};
  Reptile whole(device, parameters.slice(), gradients.slice(), group(0.02, 0.01), 3);
  for (int i = 0; i < 2; ++i) whole.step(batch, pull(centers));
  SafetensorsFile file;
  whole.save(file);
  const std::vector<float> between = values();
  for (int i = 0; i < 2; ++i) whole.step(batch, pull(centers));
  const std::vector<float> end = values();

  device.upload(parameters.slice(), between);
  Reptile again(device, parameters.slice(), gradients.slice(), group(0.02, 0.01), 3);
  again.load(file);
  EXPECT_EQ(again.steps(), 2u);
  for (int i = 0; i < 2; ++i) again.step(batch, pull(centers));
  EXPECT_EQ(values(), end);

  Reptile other(device, parameters.slice(), gradients.slice(), {{"sdf", 0, 2 * count, 0.02, 0.01}}, 3);
  EXPECT_THROW(other.load(file), InputError);
  Reptile renamed(device, parameters.slice(), gradients.slice(), {{"skinning", 0, count, 0.02, 0.01}}, 3);
  EXPECT_THROW(renamed.load(file), InputError);
}

// A group whose gradient is two frames' outer products goes where the same sum, written out, takes it, and has no place in the
// buffer of gradients.
TEST_F(ReptileTest, OuterProductsLeadWhereTheirSumDoes) {
  constexpr uint32_t rows = 8, columns = 8, frames = 2;
  const std::vector<float> a = uniform(frames * rows), b = uniform(frames * columns);
  Buffer at_a = filled("a", a), at_b = filled("b", b);
  std::vector<float> sum(count);
  for (uint32_t i = 0; i < frames; ++i)
    for (uint32_t row = 0; row < rows; ++row)
      for (uint32_t column = 0; column < columns; ++column) sum[row * columns + column] += a[i * rows + row] * b[i * columns + column];
  const std::array<std::size_t, 2> batch{0, 1};

  Reptile written(device, parameters.slice(), gradients.slice(), {{"matrix", count, 2 * count, 0.02, 0.01, {}}}, 5);
  const auto write = [&](Commands& pending, std::size_t, uint32_t) {
    pending.submit_and_wait();
    device.upload(gradients.slice().elements(count, count), sum);
  };
  for (int step = 0; step < 3; ++step) written.step(batch, write);
  const std::vector<float> expected = values();

  device.upload(parameters.slice(), std::vector<float>(3 * count, 0.5F));
  ReptileGroup formed{"matrix", count, 2 * count, 0.02, 0.01, {}};
  formed.outer_gradients = [&] {
    OuterProduct product;
    product.pairs = frames;
    product.a = at_a.slice(), product.rows = product.row_stride = rows;
    product.b = at_b.slice(), product.columns = product.column_stride = columns;
    return std::vector<OuterGradient>{{count, 2 * count, product}};
  };
  Reptile outer(device, parameters.slice(), gradients.slice().elements(0, count), {formed}, 5);
  for (int step = 0; step < 3; ++step) outer.step(batch, [](Commands&, std::size_t, uint32_t) {});
  const std::vector<float> found = values();
  for (uint64_t i = 0; i < 3 * count; ++i) ASSERT_NEAR(found[i], expected[i], 1e-6) << i;
  EXPECT_GT(std::abs(found[count] - 0.5F), 0.01F);
}

TEST_F(ReptileTest, NumbersThatAreNotFiniteLeaveTheParameters) {
  Reptile reptile(device, parameters.slice(), gradients.slice(), group(0.02, 0.01), 3);
  const std::array<std::size_t, 1> one{0};
  EXPECT_THROW(reptile.step(one, pull({std::numeric_limits<float>::quiet_NaN()})), std::runtime_error);
  EXPECT_EQ(values()[count], 0.5F);
  EXPECT_EQ(reptile.steps(), 0u);
}

}  // namespace
}  // namespace arah
