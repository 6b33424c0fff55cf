#include "kernels/reference/adam.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "tests/golden.h"

namespace arah::reference {
namespace {

TEST(Adam, Golden10) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("10_adam");
  const std::vector<std::string> names{"a", "b", "c", "latent"};
  const std::vector<double> rates{1e-6, 1e-4, 1e-4, 1e-4}, decays{0, 0, 0, 0.05};
  // One flat buffer, the four tensors behind one another.
  std::vector<AdamGroup> groups;
  std::vector<double> parameters;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto start = truth.values("in.p." + names[i]);
    groups.push_back({parameters.size(), start.size(), rates[i], decays[i], 0});
    parameters.insert(parameters.end(), start.begin(), start.end());
  }
  const std::vector<double> start = parameters;
  std::vector<double> m(parameters.size()), v(parameters.size()), gradients(parameters.size());
  std::map<std::string, std::vector<double>> history;
  const auto slice = [&groups](const std::vector<double>& buffer, std::size_t i) {
    const auto begin = buffer.begin() + static_cast<std::ptrdiff_t>(groups[i].offset);
    return std::vector<double>(begin, begin + static_cast<std::ptrdiff_t>(groups[i].count));
  };
  for (int step = 1; step <= 5; ++step) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto all = truth.values("in.g." + names[i]);
      for (std::size_t j = 0; j < groups[i].count; ++j)
        gradients[groups[i].offset + j] = all[(step - 1) * groups[i].count + j];
    }
    adam_step(parameters, gradients, m, v, groups, step);
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto now = slice(parameters, i);
      history[names[i]].insert(history[names[i]].end(), now.begin(), now.end());
    }
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    golden::expect_golden(truth, "out." + names[i], history[names[i]]);
    golden::expect_golden(truth, "out.m." + names[i], slice(m, i));
    golden::expect_golden(truth, "out.v." + names[i], slice(v, i));
    // The moves are 1e-6 to 5e-4: compared on their own scale too.
    std::vector<double> moved = history[names[i]], expected = truth.values("out." + names[i]);
    double scale = 0;
    for (std::size_t j = 0; j < moved.size(); ++j) {
      moved[j] -= start[groups[i].offset + j % groups[i].count];
      expected[j] -= start[groups[i].offset + j % groups[i].count];
      scale = std::max(scale, std::abs(expected[j]));
    }
    // Parameters of size 1 are stored to 1e-16, so their difference is known to some 1e-15.
    golden::expect_close("moves of " + names[i], moved, expected, 1e-10 * scale + 1e-15);
  }
}

TEST(Adam, ParametersInNoGroupStay) {
  std::vector<double> p{1, 2, 3, 4, 5}, m(5), v(5);
  const std::vector<double> g{1, 1, 1, 1, 1};
  adam_step(p, g, m, v, std::vector<AdamGroup>{{1, 2, 0.1}}, 1);
  EXPECT_EQ(p[0], 1);
  EXPECT_EQ(p[3], 4);
  EXPECT_EQ(m[4], 0);
  EXPECT_NEAR(p[1], 1.9, 1e-8);  // the first step is rate · sign(g)
  EXPECT_NEAR(p[2], 2.9, 1e-8);
}

TEST(Adam, GradientNormIsClippedPerGroup) {
  // Group 0 has norm 5, clipped to 1; group 1 has norm 0.5, below its limit.
  std::vector<double> p(3), m(3), v(3);
  const std::vector<double> g{3, 4, 0.5};
  const auto norms = adam_step(p, g, m, v, std::vector<AdamGroup>{{0, 2, 0.1, 0, 1}, {2, 1, 0.1, 0, 1}}, 1);
  EXPECT_NEAR(norms[0], 5, 1e-15);
  EXPECT_NEAR(norms[1], 0.5, 1e-15);
  EXPECT_NEAR(m[0], 0.1 * 0.6, 1e-15);
  EXPECT_NEAR(m[1], 0.1 * 0.8, 1e-15);
  EXPECT_NEAR(m[2], 0.1 * 0.5, 1e-15);
}

TEST(Adam, WeightDecayIsAddedAfterClipping) {
  std::vector<double> p{2}, m(1), v(1);
  adam_step(p, std::vector<double>{10}, m, v, std::vector<AdamGroup>{{0, 1, 0, 0.25, 1}}, 1);
  EXPECT_NEAR(m[0], 0.1 * (1 + 0.25 * 2), 1e-15);
  EXPECT_EQ(p[0], 2);  // rate 0: the moments learn, the parameter stays
}

TEST(Adam, NonFiniteGradientLeavesItsGroupAlone) {
  const double inf = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
  for (double bad : {inf, -inf, nan, 1e200}) {
    std::vector<double> p{1, 2, 3}, m{0.1, 0.2, 0.3}, v{1, 1, 1};
    const auto norms = adam_step(p, std::vector<double>{0.5, bad, 0.5}, m, v,
                                 std::vector<AdamGroup>{{0, 2, 0.1, 0.1, 10}, {2, 1, 0.1}}, 3);
    EXPECT_FALSE(std::isfinite(norms[0]));
    EXPECT_EQ(p[0], 1);
    EXPECT_EQ(p[1], 2);
    EXPECT_EQ(m[0], 0.1);
    EXPECT_EQ(v[1], 1);
    EXPECT_NE(p[2], 3);
  }
}

TEST(Adam, ZeroGradientFromRestDoesNotMove) {
  std::vector<double> p{1}, m(1), v(1);
  adam_step(p, std::vector<double>{0}, m, v, std::vector<AdamGroup>{{0, 1, 0.1}}, 1);
  EXPECT_EQ(p[0], 1);
}

TEST(WeightAverage, FollowsWithTheGivenDecay) {
  std::vector<double> average{0, 10};
  for (int i = 0; i < 3; ++i) update_average(average, std::vector<double>{1, 10}, 0.5);
  EXPECT_NEAR(average[0], 1 - 0.125, 1e-15);
  EXPECT_EQ(average[1], 10);
  update_average(average, std::vector<double>{7, 8}, 0);
  EXPECT_EQ(average, (std::vector<double>{7, 8}));
}

TEST(RateFactor, FreezeThenWarmUpThenDecay) {
  const RateSchedule schedule{200, 100, RateSchedule::Decay::none, 1000, 1};
  EXPECT_EQ(rate_factor(schedule, 0), 0);
  EXPECT_EQ(rate_factor(schedule, 199), 0);
  EXPECT_NEAR(rate_factor(schedule, 200), 0.01, 1e-15);
  EXPECT_NEAR(rate_factor(schedule, 299), 1, 1e-15);
  EXPECT_EQ(rate_factor(schedule, 5000), 1);
}

TEST(RateFactor, DecaysToTheEndFractionAndStays) {
  for (auto decay : {RateSchedule::Decay::cosine, RateSchedule::Decay::exponential}) {
    const RateSchedule schedule{0, 0, decay, 400, 0.04};
    EXPECT_NEAR(rate_factor(schedule, 0), 1, 1e-15);
    EXPECT_NEAR(rate_factor(schedule, 200), decay == RateSchedule::Decay::cosine ? 0.52 : 0.2, 1e-12);
    EXPECT_NEAR(rate_factor(schedule, 400), 0.04, 1e-15);
    EXPECT_NEAR(rate_factor(schedule, 4000), 0.04, 1e-15);
    for (int step = 1; step <= 400; ++step) EXPECT_LT(rate_factor(schedule, step), rate_factor(schedule, step - 1));
  }
}

TEST(RateFactor, GroupsThatStartLateEndTogether) {
  const RateSchedule early{0, 0, RateSchedule::Decay::cosine, 1000, 0.02};
  const RateSchedule late{300, 50, RateSchedule::Decay::cosine, 1000, 0.02};
  for (int step : {349, 500, 1000}) EXPECT_EQ(rate_factor(early, step), rate_factor(late, step));
}

}  // namespace
}  // namespace arah::reference
