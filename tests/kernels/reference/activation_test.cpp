#include "kernels/reference/activation.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/kernels/reference/finite_differences.h"

namespace arah::reference {
namespace {

constexpr Activation kAll[] = {Activation::none,     Activation::relu, Activation::leaky_relu,
                               Activation::softplus, Activation::sine, Activation::sigmoid};

TEST(Activation, DerivativesMatchFiniteDifferences) {
  for (Activation activation : kAll) {
    for (double x : {-3.0, -0.71, -0.013, 0.007, 0.1, 0.9, 2.3}) {
      const double h = 1e-5;
      const auto difference = [&](auto&& f) {
        return (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / (12 * h);
      };
      EXPECT_NEAR(activate_derivative(activation, x), difference([&](double at) { return activate(activation, at); }),
                  1e-9)
          << static_cast<int>(activation) << " at " << x;
      EXPECT_NEAR(activate_second_derivative(activation, x),
                  difference([&](double at) { return activate_derivative(activation, at); }), 1e-7)
          << static_cast<int>(activation) << " at " << x;
    }
  }
}

TEST(Activation, StaysFiniteAtTheExtremes) {
  for (Activation activation : kAll) {
    for (double x : {-1e300, -1e6, -1e-320, 0.0, 1e-320, 1e6, 1e300}) {
      EXPECT_TRUE(std::isfinite(activate(activation, x))) << static_cast<int>(activation) << " at " << x;
      EXPECT_TRUE(std::isfinite(activate_derivative(activation, x))) << static_cast<int>(activation) << " at " << x;
      EXPECT_TRUE(std::isfinite(activate_second_derivative(activation, x)))
          << static_cast<int>(activation) << " at " << x;
    }
    EXPECT_TRUE(std::isnan(activate(activation, std::nan("")))) << static_cast<int>(activation) << " swallows NaN";
  }
  EXPECT_EQ(activate(Activation::softplus, 1e6), 1e6);
  EXPECT_EQ(activate(Activation::softplus, -1e6), 0);
  EXPECT_EQ(activate(Activation::relu, -std::numeric_limits<double>::infinity()), 0);
}

TEST(Activation, SoftplusSwitchesAtItsThreshold) {
  // exactly linear above 100 x = 20, log(1 + exp(20)) / 100 = 0.2 + 2.06e-11 just below
  EXPECT_EQ(activate(Activation::softplus, 0.2001), 0.2001);
  EXPECT_NEAR(activate(Activation::softplus, 0.2) - 0.2, std::exp(-20.0) / 100, 1e-15);
  EXPECT_EQ(activate_derivative(Activation::softplus, 0.2001), 1);
  EXPECT_LT(activate_derivative(Activation::softplus, 0.1999), 1);
}

TEST(Activation, SigmoidKeepsItsTails) {
  EXPECT_NEAR(sigmoid(-700) / std::exp(-700.0), 1, 1e-14);
  EXPECT_NEAR(activate_derivative(Activation::sigmoid, 50) / std::exp(-50.0), 1, 1e-14);
}

}  // namespace
}  // namespace arah::reference
