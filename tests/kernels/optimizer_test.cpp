// Norm, clipping and Adam on the device, against double precision and the golden tensors.
#include <cmath>
#include <limits>

#include "kernels/optimizer/adam.h"
#include "kernels/optimizer/clip_scale.h"
#include "kernels/optimizer/sum_of_squares.h"
#include "kernels/reference/adam.h"
#include "tests/golden.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

using shared::GradientNorm;

class Optimizer : public DeviceTest {
 protected:
  GradientNorm norm_of(const std::vector<float>& gradient, float max_norm) {
    Buffer g = filled("gradient", gradient), norms = filled("norms", std::vector<GradientNorm>(4, {-1, -1, 77, 77})),
           partials = empty("partials", squares_partials(gradient.size()) * 8 + 64);
    record_sum_of_squares(commands, {g.slice().elements(0, gradient.size()), partials.slice(), 0});
    record_clip_scale(commands, {squares_partials(gradient.size()), partials.slice(), max_norm, norms.slice(), 2});
    commands.submit_and_wait();
    const auto all = device.download<GradientNorm>(norms.slice());
    EXPECT_EQ(all[1].nonfinite, 77u) << "a neighbour's record changed";
    EXPECT_EQ(all[3].nonfinite, 77u) << "a neighbour's record changed";
    return all[2];
  }
};

double largest(const std::vector<double>& values) {
  double scale = 0;
  for (const double x : values) scale = std::max(scale, std::abs(x));
  return scale;
}

double double_norm(const std::vector<float>& values) {
  double sum = 0;
  for (const float x : values) sum += double(x) * x;
  return std::sqrt(sum);
}

TEST_F(Optimizer, NormAndClippingFactor) {
  for (const size_t count : {64u, 192u, 16384u, 16448u, 100032u}) {
    const std::vector<float> gradient = uniform(count, -3, 3);
    const double norm = double_norm(gradient);
    const GradientNorm clipped = norm_of(gradient, 10);
    EXPECT_NEAR(clipped.norm, norm, 2e-6 * norm) << count;
    EXPECT_NEAR(clipped.scale, std::min(1.0, 10 / norm), 2e-6) << count;
    EXPECT_EQ(clipped.nonfinite, 0u);
    EXPECT_EQ(clipped.usable, 1u);
  }
  const std::vector<float> small(64, 0.01F);
  EXPECT_EQ(norm_of(small, 10).scale, 1);
  EXPECT_EQ(norm_of(std::vector<float>(64, 1e6F), 0).scale, 1) << "0 is no limit";
  EXPECT_EQ(norm_of(std::vector<float>(64, 0.0F), 10).scale, 1);
}

TEST_F(Optimizer, BadNumbersAreCountedAndMakeTheGroupUnusable) {
  std::vector<float> gradient = uniform(20032);
  gradient[0] = NAN;
  gradient[63] = INFINITY;
  gradient[16384] = -INFINITY;
  gradient[20031] = std::numeric_limits<float>::quiet_NaN();
  const GradientNorm norm = norm_of(gradient, 10);
  EXPECT_EQ(norm.nonfinite, 4u);
  EXPECT_EQ(norm.usable, 0u);
  // Finite numbers whose squares overflow: none is bad, the norm is.
  std::vector<float> huge(64, 1e30F);
  const GradientNorm overflow = norm_of(huge, 10);
  EXPECT_EQ(overflow.nonfinite, 0u);
  EXPECT_EQ(overflow.usable, 0u);
}

TEST_F(Optimizer, PartialsOfSeveralRangesLieBehindOneAnother) {
  const std::vector<float> gradient = uniform(40000);
  Buffer g = filled("gradient", gradient), norms = empty("norms", 256), partials = empty("partials", 256);
  const uint64_t first = 20032;
  record_sum_of_squares(commands, {g.slice().elements(0, first), partials.slice(), 0});
  record_sum_of_squares(commands,
                        {g.slice().elements(first, 40000 - first), partials.slice(), squares_partials(first)});
  record_clip_scale(commands,
                    {squares_partials(first) + squares_partials(40000 - first), partials.slice(), 0, norms.slice(), 0});
  commands.submit_and_wait();
  const double truth = double_norm(gradient);
  EXPECT_NEAR(device.download<GradientNorm>(norms.slice())[0].norm, truth, 2e-6 * truth);
}

// Five steps of one group on device and in double precision.
struct AdamCase {
  size_t count;
  double rate, weight_decay, max_norm;
};

TEST_F(Optimizer, AdamFollowsTheReferenceThroughClippingDecayAndAverage) {
  for (const AdamCase& shape :
       {AdamCase{64, 1e-3, 0, 0}, AdamCase{1088, 1e-4, 0.05, 0}, AdamCase{20032, 1e-3, 0.01, 5}}) {
    const std::vector<float> start = uniform(shape.count);
    Buffer p = filled("parameters", start), m = filled("m", std::vector<float>(shape.count, 0.0F)),
           v = filled("v", std::vector<float>(shape.count, 0.0F)), average = filled("average", start),
           norms = empty("norms", 256), partials = empty("partials", 256);
    std::vector<double> parameters(start.begin(), start.end()), first(shape.count), second(shape.count),
        mean = parameters;
    const auto range = [&shape](Buffer& buffer) { return buffer.slice().elements(0, shape.count); };
    for (uint32_t step = 1; step <= 5; ++step) {
      const std::vector<float> gradient = uniform(shape.count, -2, 2);
      Buffer g = filled("gradient", gradient);
      record_sum_of_squares(commands, {range(g), partials.slice(), 0});
      record_clip_scale(commands, {squares_partials(shape.count), partials.slice(), static_cast<float>(shape.max_norm),
                                   norms.slice(), 1});
      AdamArgs args;
      args.step = step;
      args.rate = shape.rate;
      args.weight_decay = shape.weight_decay;
      args.average_decay = 0.9;
      args.parameters = range(p);
      args.gradients = range(g);
      args.first_moments = range(m);
      args.second_moments = range(v);
      args.averages = range(average);
      args.norms = norms.slice();
      args.norm_index = 1;
      record_adam(commands, args);
      commands.submit_and_wait();
      EXPECT_EQ(device.download<float>(range(g)), gradient) << "Adam must not change the gradient";
      const std::vector<double> wide(gradient.begin(), gradient.end());
      const std::vector<reference::AdamGroup> group{{0, shape.count, shape.rate, shape.weight_decay, shape.max_norm}};
      reference::adam_step(parameters, wide, first, second, group, static_cast<int>(step));
      reference::update_average(mean, parameters, 0.9);
    }
    const auto compare = [&](const char* label, Buffer& buffer, const std::vector<double>& truth, double relative) {
      const auto values = device.download<float>(range(buffer));
      golden::expect_close(label + (" of " + std::to_string(shape.count)),
                           std::vector<double>(values.begin(), values.end()), truth, relative * largest(truth));
    };
    compare("parameters", p, parameters, 5e-7);
    compare("m", m, first, 1e-6);
    compare("v", v, second, 1e-6);
    compare("average", average, mean, 5e-7);
  }
}

TEST_F(Optimizer, Golden10) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("10_adam");
  const std::vector<std::string> names{"a", "b", "c", "latent"};
  const double rates[] = {1e-6, 1e-4, 1e-4, 1e-4}, decays[] = {0, 0, 0, 0.05};
  for (size_t i = 0; i < names.size(); ++i) {
    const auto start = truth.tensor("in.p." + names[i]).as<float>(), all = truth.tensor("in.g." + names[i]).as<float>();
    const size_t count = start.size(), padded = (count + 63) / 64 * 64;
    std::vector<float> initial = start;
    initial.resize(padded, 0.0F);
    const std::vector<float> zero(padded, 0.0F);
    Buffer p = filled("parameters", initial), m = filled("m", zero), v = filled("v", zero);
    const auto range = [padded](Buffer& buffer) { return buffer.slice().elements(0, padded); };
    std::vector<double> moved;
    for (uint32_t step = 1; step <= 5; ++step) {
      std::vector<float> gradient(all.begin() + static_cast<std::ptrdiff_t>((step - 1) * count),
                                  all.begin() + static_cast<std::ptrdiff_t>(step * count));
      gradient.resize(padded, 0.0F);
      Buffer g = filled("gradient", gradient);
      AdamArgs args;
      args.step = step;
      args.rate = rates[i];
      args.weight_decay = decays[i];
      args.parameters = range(p);
      args.gradients = range(g);
      args.first_moments = range(m);
      args.second_moments = range(v);
      record_adam(commands, args);
      commands.submit_and_wait();
      const auto now = device.download<float>(range(p));
      for (size_t j = 0; j < count; ++j) moved.push_back(double(now[j]) - start[j]);
    }
    // Moves of 1e-6 to 5e-4 of parameters that single precision holds to 6e-8 of their size, five times.
    std::vector<double> expected = truth.values("out." + names[i]);
    for (size_t j = 0; j < expected.size(); ++j) expected[j] -= start[j % count];
    golden::expect_close("moves of " + names[i], moved, expected, 3e-7 * largest(truth.values("in.p." + names[i])));
    for (const char* moment : {"out.m.", "out.v."}) {
      const auto expected_moment = truth.values(moment + names[i]);
      auto values = device.download<float>(range(moment[4] == 'm' ? m : v));
      values.resize(count);
      golden::expect_close(moment + names[i], std::vector<double>(values.begin(), values.end()), expected_moment,
                           2e-6 * largest(expected_moment));
    }
  }
}

TEST_F(Optimizer, AGroupWithoutAFiniteNormIsLeftAsItIs) {
  const std::vector<float> start = uniform(128), moment = uniform(128, 0, 1);
  std::vector<float> gradient = uniform(128);
  gradient[100] = NAN;
  Buffer p = filled("parameters", start), g = filled("gradient", gradient), m = filled("m", moment),
         v = filled("v", moment), norms = empty("norms", 256), partials = empty("partials", 256);
  record_sum_of_squares(commands, {g.slice(), partials.slice(), 0});
  record_clip_scale(commands, {1, partials.slice(), 10, norms.slice(), 0});
  AdamArgs args;
  args.rate = 0.1;
  args.weight_decay = 0.1;
  args.parameters = p.slice();
  args.gradients = g.slice();
  args.first_moments = m.slice();
  args.second_moments = v.slice();
  args.norms = norms.slice();
  record_adam(commands, args);
  commands.submit_and_wait();
  EXPECT_EQ(device.download<float>(p.slice()), start);
  EXPECT_EQ(device.download<float>(m.slice()), moment);
  EXPECT_EQ(device.download<float>(v.slice()), moment);
  EXPECT_EQ(device.download<GradientNorm>(norms.slice())[0].nonfinite, 1u);
}

TEST_F(Optimizer, LazyAdamTouchesOnlyGroupsThatHaveAGradient) {
  const size_t count = 9024;  // two workgroups and some
  const double unit = 1.0 / 65536;
  const std::vector<float> start = uniform(count), m0 = uniform(count), v0 = uniform(count, 0, 1),
                           average0 = uniform(count);
  std::vector<int32_t> words(count, 0);
  for (size_t eight = 0; eight < count / 8; eight += 1 + generator() % 6)
    for (size_t i = 0; i < 1 + generator() % 8; ++i)
      words[8 * eight + generator() % 8] = static_cast<int32_t>(generator() % 400000) - 200000;
  Buffer p = filled("parameters", start), g = filled("words", words), m = filled("m", m0), v = filled("v", v0),
         average = filled("average", average0);
  AdamArgs args;
  args.step = 7;
  args.rate = 1e-2;
  args.average_decay = 0.9;
  args.parameters = p.slice();
  args.gradients = g.slice();
  args.first_moments = m.slice();
  args.second_moments = v.slice();
  args.averages = average.slice();
  args.lazy = true;
  args.gradient_unit = static_cast<float>(unit);
  record_adam(commands, args);
  commands.submit_and_wait();
  const auto p1 = device.download<float>(p.slice()), m1 = device.download<float>(m.slice()),
             v1 = device.download<float>(v.slice()), average1 = device.download<float>(average.slice());
  size_t touched = 0;
  for (size_t eight = 0; eight < count / 8; ++eight) {
    bool any = false;
    for (size_t i = 8 * eight; i < 8 * eight + 8; ++i) any |= words[i] != 0;
    touched += any;
    for (size_t i = 8 * eight; i < 8 * eight + 8; ++i) {
      if (!any) {
        ASSERT_TRUE(p1[i] == start[i] && m1[i] == m0[i] && v1[i] == v0[i] && average1[i] == average0[i]) << i;
        continue;
      }
      std::vector<double> parameter{start[i]}, gradient{unit * words[i]}, first{m0[i]}, second{v0[i]},
          mean{average0[i]};
      const std::vector<reference::AdamGroup> group{{0, 1, 1e-2, 0, 0}};
      reference::adam_step(parameter, gradient, first, second, group, 7);
      reference::update_average(mean, parameter, 0.9);
      ASSERT_NEAR(p1[i], parameter[0], 1e-6) << i;
      ASSERT_NEAR(m1[i], first[0], 1e-6) << i;
      ASSERT_NEAR(v1[i], second[0], 1e-6) << i;
      ASSERT_NEAR(average1[i], mean[0], 1e-6) << i;
    }
  }
  EXPECT_GT(touched, 0u);
  EXPECT_LT(touched, count / 8);
  EXPECT_EQ(device.download<int32_t>(g.slice()), std::vector<int32_t>(count, 0)) << "used words go back to 0";
}

TEST_F(Optimizer, RangesThatDoNotFitAreRefused) {
  Buffer a = empty("a", 1024), b = empty("b", 512);
  AdamArgs args;
  args.parameters = args.gradients = args.first_moments = a.slice();
  args.second_moments = b.slice();
  EXPECT_THROW(record_adam(commands, args), std::invalid_argument);
  args.second_moments = a.slice();
  args.step = 0;
  EXPECT_THROW(record_adam(commands, args), std::invalid_argument);
  EXPECT_THROW(record_sum_of_squares(commands, {a.slice().elements(0, 60), b.slice(), 0}), std::invalid_argument);
}

}  // namespace
}  // namespace arah
