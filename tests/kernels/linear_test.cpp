// Both families of linear kernels against the double-precision truth.
#include "kernels/linear/linear.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <optional>

#include "kernels/reference/linear.h"
#include "shaders/shared/work_count.h"
#include "tests/kernels/closeness.h"
#include "tests/kernels/device_fixture.h"
#include "tests/kernels/linear_truth.h"

namespace arah {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();

// Sets ARAH_LINEAR while it lives.
class FamilyChoice {
 public:
  explicit FamilyChoice(const char* family) {
    if (const char* before = std::getenv("ARAH_LINEAR")) before_ = before;
    setenv("ARAH_LINEAR", family, 1);
  }
  ~FamilyChoice() {
    if (before_)
      setenv("ARAH_LINEAR", before_->c_str(), 1);
    else
      unsetenv("ARAH_LINEAR");
  }
  FamilyChoice(const FamilyChoice&) = delete;
  FamilyChoice& operator=(const FamilyChoice&) = delete;

 private:
  std::optional<std::string> before_;
};

// A matrix on the device with columns on both sides that do not belong to it.
struct TestMatrix {
  std::string name;
  uint32_t points = 0, channels = 0, stride = 0, column = 8;
  Buffer buffer;

  Matrix matrix() { return {buffer.slice(), stride, column}; }
};

class LinearTest : public DeviceTest {
 protected:
  // Channels of all padded points: `values`, or NaN where it is empty.
  TestMatrix matrix(const std::string& name, uint32_t points, uint32_t channels,
                    const std::vector<float>& values = {}) {
    const uint32_t padded = padded_points(points), stride = channels + 16;
    std::vector<float> all(size_t(padded) * stride, nan);
    if (!values.empty())
      for (uint32_t p = 0; p < padded; ++p)
        for (uint32_t c = 0; c < channels; ++c) all[size_t(p) * stride + 8 + c] = values.at(size_t(p) * channels + c);
    return {name, points, channels, stride, 8, filled(name, all)};
  }

  // The real rows; the columns beside must be untouched.
  std::vector<double> result(TestMatrix& m) {
    const std::vector<float> all = device.download<float>(m.buffer.slice());
    std::vector<double> rows;
    for (uint32_t p = 0; p < m.points; ++p) {
      for (uint32_t c = 0; c < m.stride; ++c) {
        const float value = all[size_t(p) * m.stride + c];
        if (c >= 8 && c < 8 + m.channels)
          rows.push_back(value);
        else
          EXPECT_TRUE(std::isnan(value)) << m.name << ": column " << c << " is not the kernel's";
      }
    }
    return rows;
  }

  EffectiveWeights weights(uint32_t inputs, uint32_t outputs) {
    // rounded to float, so that truth and kernel start from the same numbers
    return {inputs, outputs, as_doubles(uniform(size_t(inputs) * outputs)), as_doubles(uniform(outputs))};
  }

  std::vector<double> real_rows(const std::vector<float>& values, uint32_t points, uint32_t channels) {
    return {values.begin(), values.begin() + long(points) * channels};
  }
};

// Rounding of a sum of `terms` products of numbers up to 1 in size, in any order.
double sum_tolerance(uint32_t terms) {
  return 1e-7 * terms + 5e-7;
}

reference::Activation truth_of(Activation activation) {
  return static_cast<reference::Activation>(activation);
}

// Sizes are padded widths: what the kernels see.
struct ForwardCase {
  const char* family;
  Activation activation;
  uint32_t inputs, outputs, points;
};
void PrintTo(const ForwardCase& c, std::ostream* out) {
  *out << c.family << ", activation " << static_cast<int>(c.activation) << ", " << c.inputs << " to " << c.outputs
       << ", " << c.points << " points";
}

class LinearForward : public LinearTest, public testing::WithParamInterface<ForwardCase> {};

TEST_P(LinearForward, MatchesTheTruth) {
  const auto [family, activation, inputs, outputs, points] = GetParam();
  const FamilyChoice choice(family);
  const EffectiveWeights layer = weights(inputs, outputs);
  const std::vector<float> x = uniform(size_t(padded_points(points)) * inputs);
  Buffer forward = filled("weights", packed_forward(layer));
  TestMatrix x_matrix = matrix("x", points, inputs, x), y = matrix("y", points, outputs),
             cosine = matrix("cosine", points, outputs);
  LinearForwardArgs args;
  args.x = x_matrix.matrix();
  args.weights = {inputs, outputs, forward.slice(), {}};
  args.y = y.matrix();
  args.activation = activation;
  if (activation == Activation::sine) args.cosine = cosine.matrix();
  args.range.points = points;
  record_linear_forward(commands, args);
  commands.submit_and_wait();

  const reference::LinearShape shape{points, inputs, outputs};
  const std::vector<double> x_truth = real_rows(x, points, inputs);
  expect_close("value", result(y), reference::linear_forward(shape, x_truth, layer.w, layer.b, truth_of(activation)),
               sum_tolerance(inputs));
  if (activation == Activation::sine) {
    std::vector<double> truth = reference::linear_pre_activation(shape, x_truth, layer.w, layer.b);
    for (double& value : truth) value = std::cos(value);
    expect_close("cosine", result(cosine), truth, sum_tolerance(inputs));
  }
}

constexpr ForwardCase forward_cases[] = {
    {"", Activation::none, 8, 8, 1},          {"", Activation::relu, 40, 72, 65},
    {"", Activation::leaky_relu, 24, 16, 64}, {"", Activation::softplus, 16, 24, 63},
    {"", Activation::sine, 80, 48, 130},      {"", Activation::sigmoid, 8, 8, 1000},
    {"", Activation::none, 32, 128, 65},      {"", Activation::sine, 64, 96, 63},  // tiles of 64 and of 32
    {"", Activation::sine, 136, 72, 65},      {"", Activation::relu, 296, 256, 130}};  // wide

template <typename Case, size_t count>
std::vector<Case> both_families(const Case (&cases)[count]) {
  std::vector<Case> result;
  for (const char* family : {"straight", "tiled"}) {
    for (Case c : cases) {
      c.family = family;
      result.push_back(c);
    }
  }
  return result;
}

INSTANTIATE_TEST_SUITE_P(Activations, LinearForward, testing::ValuesIn(both_families(forward_cases)));

struct GradientCase {
  const char* family;
  Activation below;
  bool before, after, raw;
  uint32_t inputs, outputs, points;
};
void PrintTo(const GradientCase& c, std::ostream* out) {
  *out << c.family << ", derivative " << static_cast<int>(c.below) << (c.before ? ", before" : "")
       << (c.after ? ", after" : "") << (c.raw ? ", raw" : "");
}

class LinearInputGradient : public LinearTest, public testing::WithParamInterface<GradientCase> {};

TEST_P(LinearInputGradient, MatchesTheTruth) {
  const auto [family, below, has_before, has_after, has_raw, inputs, outputs, points] = GetParam();
  const FamilyChoice choice(family);
  const EffectiveWeights layer = weights(inputs, outputs);
  const size_t rows = padded_points(points);
  const std::vector<float> dy = uniform(rows * outputs), before = uniform(rows * inputs),
                           after = uniform(rows * inputs);
  // pre-activations of the layer below, small enough that the bend of the softplus is met
  const std::vector<float> below_pre = uniform(rows * inputs, -0.3, 0.3);
  std::vector<float> stored(below_pre.size());
  for (size_t i = 0; i < stored.size(); ++i) {
    const double pre = below_pre[i];
    stored[i] =
        static_cast<float>(below == Activation::sine ? std::cos(pre) : reference::activate(truth_of(below), pre));
  }
  Buffer transposed = filled("weights", packed_transposed(layer));
  TestMatrix dy_matrix = matrix("dy", points, outputs, dy), stored_matrix = matrix("stored", points, inputs, stored);
  TestMatrix before_matrix = matrix("before", points, inputs, before),
             after_matrix = matrix("after", points, inputs, after);
  TestMatrix found = matrix("result", points, inputs), raw = matrix("raw", points, inputs);
  LinearInputGradientArgs args;
  args.dy = dy_matrix.matrix();
  args.weights = {inputs, outputs, {}, transposed.slice()};
  args.result = found.matrix();
  args.activation_below = below;
  if (below != Activation::none) args.stored = stored_matrix.matrix();
  if (has_before) args.before = before_matrix.matrix();
  if (has_after) args.after = after_matrix.matrix();
  if (has_raw) args.raw = raw.matrix();
  args.range.points = points;
  record_linear_input_gradient(commands, args);
  commands.submit_and_wait();

  std::vector<double> truth = reference::linear_input_gradient({points, inputs, outputs},
                                                               real_rows(dy, points, outputs), layer.w),
                      raw_truth = truth;
  for (size_t i = 0; i < truth.size(); ++i) {
    raw_truth[i] += has_before ? before[i] : 0;
    truth[i] =
        raw_truth[i] * reference::activate_derivative(truth_of(below), below_pre[i]) + (has_after ? after[i] : 0);
  }
  // the softplus's derivative comes from its value: 100 times its rounding
  const double derivative_error = below == Activation::softplus ? 1e-6 * std::sqrt(double(outputs)) : 0;
  expect_close("gradient", result(found), truth, sum_tolerance(outputs) + derivative_error);
  if (has_raw) expect_close("gradient before the derivative", result(raw), raw_truth, sum_tolerance(outputs));
}

constexpr GradientCase gradient_cases[] = {{"", Activation::none, false, false, false, 24, 8, 1},
                                           {"", Activation::relu, true, false, false, 16, 40, 65},
                                           {"", Activation::leaky_relu, false, true, false, 72, 24, 64},
                                           {"", Activation::softplus, true, true, true, 8, 72, 63},
                                           {"", Activation::sine, false, true, true, 48, 80, 130},
                                           {"", Activation::sigmoid, false, false, true, 32, 16, 300},
                                           {"", Activation::sine, true, true, true, 200, 144, 65}};  // wide
INSTANTIATE_TEST_SUITE_P(Derivatives, LinearInputGradient, testing::ValuesIn(both_families(gradient_cases)));

class LinearFamilies : public LinearTest, public testing::WithParamInterface<const char*> {
 protected:
  FamilyChoice choice{GetParam()};
};
INSTANTIATE_TEST_SUITE_P(Families, LinearFamilies, testing::Values("straight", "tiled"));

TEST_P(LinearFamilies, CarryATangentThroughASineLayer) {
  for (const auto& [inputs, outputs] : {std::pair{40u, 72u}, {136u, 72u}}) {  // the second one is a wide product
    const uint32_t points = 65;
    const size_t rows = padded_points(points);
    const EffectiveWeights layer = weights(inputs, outputs);
    const std::vector<float> x = uniform(rows * inputs), phase = uniform(rows * outputs, -4, 4),
                             adjoint = uniform(rows * outputs);
    std::vector<float> sine(phase.size()), cosine(phase.size());
    for (size_t i = 0; i < phase.size(); ++i) sine[i] = std::sin(phase[i]), cosine[i] = std::cos(phase[i]);
    Buffer forward = filled("weights", packed_forward(layer));
    TestMatrix x_matrix = matrix("x", points, inputs, x), sine_matrix = matrix("sine", points, outputs, sine),
               cosine_matrix = matrix("cosine", points, outputs, cosine);
    TestMatrix adjoint_matrix = matrix("adjoint", points, outputs, adjoint), y = matrix("y", points, outputs),
               curvature = matrix("curvature", points, outputs);
    LinearTangentArgs args;
    args.x = x_matrix.matrix();
    args.weights = {inputs, outputs, forward.slice(), {}};
    args.y = y.matrix();
    args.cosine = cosine_matrix.matrix();
    args.sine = sine_matrix.matrix();
    args.adjoint = adjoint_matrix.matrix();
    args.curvature = curvature.matrix();
    args.range.points = points;
    record_linear_tangent(commands, args);
    commands.submit_and_wait();

    const std::vector<double> a =
        reference::linear_pre_activation({points, inputs, outputs}, real_rows(x, points, inputs), layer.w, {});
    std::vector<double> y_truth(a.size()), curvature_truth(a.size());
    for (size_t i = 0; i < a.size(); ++i) {
      y_truth[i] = a[i] * cosine[i];
      curvature_truth[i] = -double(sine[i]) * a[i] * adjoint[i];
    }
    expect_close("tangent", result(y), y_truth, sum_tolerance(inputs));
    expect_close("curvature", result(curvature), curvature_truth, sum_tolerance(inputs));
  }
}

TEST_P(LinearFamilies, TakeTheNumberOfPointsFromTheDevice) {
  for (const auto& [inputs, outputs] : {std::pair{16u, 136u}, {136u, 72u}}) {  // the second one is a wide product
    const uint32_t capacity = 200, points = 100;
    const EffectiveWeights layer = weights(inputs, outputs);
    const std::vector<float> x = uniform(size_t(padded_points(capacity)) * inputs);
    Buffer forward = filled("weights", packed_forward(layer)),
           count = filled("count", std::vector<WorkCount>{{2, 1, 1, points}});
    TestMatrix x_matrix = matrix("x", capacity, inputs, x), y = matrix("y", capacity, outputs);
    LinearForwardArgs args;
    args.x = x_matrix.matrix();
    args.weights = {inputs, outputs, forward.slice(), {}};
    args.y = y.matrix();
    args.range = {capacity, count.slice()};
    record_linear_forward(commands, args);
    commands.submit_and_wait();

    const std::vector<double> all = result(y);
    const std::vector<double> truth =
        reference::linear_pre_activation({points, inputs, outputs}, real_rows(x, points, inputs), layer.w, layer.b);
    expect_close("value", {all.begin(), all.begin() + long(points) * outputs}, truth, sum_tolerance(inputs));
    for (size_t i = size_t(128) * outputs; i < all.size(); ++i)
      ASSERT_TRUE(std::isnan(all[i])) << "point " << i / outputs << " is beyond the count";
  }
}

TEST_P(LinearFamilies, AddUpTheWeightGradient) {
  struct Case {
    uint32_t inputs, outputs, points;
    bool accumulate, with_bias;
  };
  for (const auto [inputs, outputs, points, accumulate, with_bias] :
       {Case{8, 8, 1, false, true}, Case{40, 72, 1000, true, true}, Case{136, 16, 65, false, false},
        Case{72, 136, 8300, false, true}}) {
    SCOPED_TRACE(testing::Message() << inputs << " to " << outputs << ", " << points << " points");
    const size_t rows = padded_points(points);
    const std::vector<float> x = uniform(rows * inputs), before = uniform(size_t(inputs + 1) * outputs);
    std::vector<float> dy = uniform(rows * outputs);
    std::fill(dy.begin() + long(points) * outputs, dy.end(), 0.0f);  // as the interface asks
    TestMatrix x_matrix = matrix("x", points, inputs, x), dy_matrix = matrix("dy", points, outputs, dy);
    Buffer total = filled("total", before);
    const uint64_t scratch_bytes = weight_gradient_scratch_floats(inputs, outputs, points) * 4;
    Buffer scratch = filled("scratch", std::vector<float>(scratch_bytes / 4, nan));
    LinearWeightGradientArgs args;
    args.x = x_matrix.matrix();
    args.dy = dy_matrix.matrix();
    args.inputs = inputs;
    args.outputs = outputs;
    args.points = points;
    args.accumulate = accumulate;
    args.with_bias = with_bias;
    args.scratch = scratch.slice();
    args.total = total.slice();
    record_linear_weight_gradient(commands, args);
    commands.submit_and_wait();

    std::vector<double> d_w(size_t(inputs) * outputs, 0.0), d_b(outputs, 0.0);
    if (accumulate) {
      std::copy(before.begin(), before.begin() + long(d_w.size()), d_w.begin());
      std::copy(before.end() - outputs, before.end(), d_b.begin());
    }
    reference::linear_weight_gradient({points, inputs, outputs}, real_rows(x, points, inputs),
                                      real_rows(dy, points, outputs), d_w, d_b);
    const std::vector<float> found = device.download<float>(total.slice().elements(0, before.size()));
    const double tolerance = sum_tolerance(0) + 1e-8 * points + 2e-7 * std::sqrt(double(points));
    expect_close("weights", {found.begin(), found.end() - outputs}, d_w, tolerance);
    if (with_bias)
      expect_close("bias", {found.end() - outputs, found.end()}, d_b, tolerance);
    else
      EXPECT_TRUE(std::equal(found.end() - outputs, found.end(), before.end() - outputs))
          << "the bias's row is not to be touched";

    // the same bits again
    device.upload(total.slice(), before);
    record_linear_weight_gradient(commands, args);
    commands.submit_and_wait();
    EXPECT_EQ(std::memcmp(device.download<float>(total.slice().elements(0, before.size())).data(), found.data(),
                          found.size() * 4),
              0);
  }
}

TEST_P(LinearFamilies, RefuseWhatDoesNotFit) {
  TestMatrix x = matrix("x", 64, 16), y = matrix("y", 64, 16);
  Buffer forward = filled("weights", std::vector<float>(packed_floats(16, 24)));
  LinearForwardArgs args;
  args.x = x.matrix();
  args.y = y.matrix();
  args.range.points = 64;
  args.weights = {16, 24, forward.slice(), {}};  // y has 16 channels and 8 beside them
  args.y.column = 16;
  EXPECT_THROW(record_linear_forward(commands, args), std::invalid_argument);
  args.weights = {16, 12, forward.slice(), {}};
  args.y.column = 8;
  EXPECT_THROW(record_linear_forward(commands, args), std::invalid_argument);
  args.weights = {16, 16, forward.slice(), {}};
  args.range.points = 65;
  EXPECT_THROW(record_linear_forward(commands, args), std::invalid_argument);
  LinearInputGradientArgs gradient;
  gradient.name = "gradient";
  gradient.activation_below = Activation::relu;
  EXPECT_THROW(record_linear_input_gradient(commands, gradient), std::invalid_argument) << "no stored activation";
}

TEST_F(LinearTest, FollowsTheEnvironmentsChoiceOfFamily) {
  {
    const FamilyChoice straight("straight");
    EXPECT_EQ(linear_family(device), LinearFamily::straight);
  }
  const FamilyChoice tiled("tiled");
  EXPECT_EQ(linear_family(device), LinearFamily::tiled);
  const FamilyChoice wrong("fast");
  EXPECT_THROW(linear_family(device), std::invalid_argument);
}

TEST_F(LinearTest, TakesTheLastActivationsDerivative) {
  const uint32_t channels = 24, points = 65;
  const size_t rows = padded_points(points);
  const std::vector<float> dy = uniform(rows * channels), pre = uniform(rows * channels, -5, 5);
  std::vector<float> stored(pre.size());
  std::vector<double> truth;
  for (size_t i = 0; i < pre.size(); ++i) {
    stored[i] = static_cast<float>(reference::sigmoid(pre[i]));
    if (i < size_t(points) * channels)
      truth.push_back(dy[i] * reference::activate_derivative(reference::Activation::sigmoid, pre[i]));
  }
  TestMatrix dy_matrix = matrix("dy", points, channels, dy), stored_matrix = matrix("stored", points, channels, stored),
             found = matrix("result", points, channels);
  ActivationGradientArgs args;
  args.dy = dy_matrix.matrix();
  args.stored = stored_matrix.matrix();
  args.result = found.matrix();
  args.activation = Activation::sigmoid;
  args.channels = channels;
  args.points = points;
  record_activation_gradient(commands, args);
  commands.submit_and_wait();
  expect_close("gradient", result(found), truth, 2e-7);
}

}  // namespace
}  // namespace arah
