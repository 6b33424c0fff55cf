#include "kernels/reference/linear.h"

#include <gtest/gtest.h>

#include "tests/kernels/reference/finite_differences.h"

namespace arah::reference {
namespace {

TEST(Linear, ComputesAProductWorkedByHand) {
  const LinearShape shape{1, 2, 3};
  const std::vector<double> y = linear_forward(shape, std::vector<double>{2, -1}, std::vector<double>{1, 2, 3, 4, 5, 6},
                                               std::vector<double>{10, -1, -20}, Activation::relu);
  EXPECT_EQ(y, (std::vector<double>{8, 0, 0}));  // (2 - 4 + 10, 4 - 5 - 1 = -2, 6 - 6 - 20 = -20)
}

TEST(Linear, GradientsMatchFiniteDifferences) {
  const LinearShape shape{5, 7, 3};
  std::vector<double> x = random_values(35, 1, 1), w = random_values(21, 1, 2), b = random_values(3, 1, 3);
  const std::vector<double> weights = random_values(15, 1, 4);
  for (Activation activation : {Activation::sine, Activation::sigmoid, Activation::none}) {
    const auto loss = [&] { return dot(weights, linear_forward(shape, x, w, b, activation)); };
    const std::vector<double> d_a = activation_gradient(activation, linear_pre_activation(shape, x, w, b), weights);
    std::vector<double> d_w(21, 0.0), d_b(3, 0.0);
    linear_weight_gradient(shape, x, d_a, d_w, d_b);
    expect_gradient("linear x", loss, x, linear_input_gradient(shape, d_a, w), 1e-3);
    expect_gradient("linear w", loss, w, d_w, 1e-3);
    expect_gradient("linear b", loss, b, d_b, 1e-3);
  }
}

TEST(Linear, AddsToParameterGradients) {
  const LinearShape shape{2, 1, 1};
  std::vector<double> d_w = {100}, d_b = {200};
  linear_weight_gradient(shape, std::vector<double>{2, 3}, std::vector<double>{5, 7}, d_w, d_b);
  EXPECT_EQ(d_w[0], 131);
  EXPECT_EQ(d_b[0], 212);
}

TEST(Linear, AcceptsNoPointsAndNoBias) {
  EXPECT_TRUE(linear_forward({0, 3, 2}, {}, std::vector<double>(6, 1.0), {}, Activation::none).empty());
  EXPECT_EQ(linear_forward({1, 1, 1}, std::vector<double>{3}, std::vector<double>{4}, {}, Activation::none)[0], 12);
}

TEST(Linear, RefusesSizesThatDoNotFit) {
  EXPECT_THROW(linear_forward({1, 2, 3}, std::vector<double>(2), std::vector<double>(5), {}, Activation::none),
               std::invalid_argument);
  EXPECT_THROW(linear_input_gradient({2, 2, 3}, std::vector<double>(3), std::vector<double>(6)), std::invalid_argument);
}

TEST(WeightNorm, GradientsMatchFiniteDifferences) {
  const std::size_t inputs = 5, outputs = 3;
  std::vector<double> v = random_values(15, 2, 1), g = random_values(3, 2, 2);
  const std::vector<double> weights = random_values(15, 1, 3);
  const auto loss = [&] { return dot(weights, weight_norm_forward(inputs, outputs, v, g)); };
  std::vector<double> d_v(15, 0.0), d_g(3, 0.0);
  weight_norm_backward(inputs, outputs, v, g, weights, d_v, d_g);
  expect_gradient("weight norm v", loss, v, d_v, 1e-3);
  expect_gradient("weight norm g", loss, g, d_g, 1e-3);
}

TEST(WeightNorm, GivesEachOutputItsMagnitude) {
  // Lengths from 1e-200 to 1e200, where squares leave the range of double.
  const std::vector<double> v = {3e-200, 3e200, 0, 4e-200, 4e200, 0};
  const std::vector<double> w = weight_norm_forward(2, 3, v, std::vector<double>{5, -10, 7});
  const std::vector<double> expected = {3, -6, 0, 4, -8, 0};
  for (std::size_t i = 0; i < w.size(); ++i) EXPECT_NEAR(w[i], expected[i], 1e-12) << i;
  std::vector<double> d_v(6, 0.0), d_g(3, 0.0);
  weight_norm_backward(2, 3, v, std::vector<double>{5, -10, 7}, std::vector<double>(6, 1.0), d_v, d_g);
  EXPECT_EQ(d_g[2], 0);
  EXPECT_EQ(d_v[2], 0);
}

}  // namespace
}  // namespace arah::reference
