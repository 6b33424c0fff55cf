// Activations, skinning weights, normals and losses at the ends of their ranges.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "kernels/color/posed_normals.h"
#include "kernels/color/posed_normals_backward.h"
#include "kernels/linear/linear.h"
#include "kernels/losses/eikonal.h"
#include "kernels/losses/image.h"
#include "kernels/losses/mask.h"
#include "kernels/losses/normal.h"
#include "kernels/losses/sdf_penalty.h"
#include "kernels/optimizer/adam.h"
#include "kernels/reduction/sum.h"
#include "kernels/reference/activation.h"
#include "kernels/reference/hierarchical_softmax.h"
#include "kernels/reference/lbs.h"
#include "kernels/reference/losses.h"
#include "kernels/skinning/joint_tree.h"
#include "kernels/skinning/lbs.h"
#include "kernels/skinning/lbs_backward.h"
#include "kernels/skinning/weights_loss.h"
#include "tests/extremes/activations_on_device.h"
#include "tests/extremes/extremes.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

using namespace extremes;

constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();

class NetworkExtremes : public ActivationsOnDevice {
 protected:
  static std::vector<double> doubles(const std::vector<float>& values) { return {values.begin(), values.end()}; }
};

TEST_F(NetworkExtremes, SoftplusFromMinusAMillionToAMillion) {
  std::vector<float> x = {-1e6F, 1e6F};
  for (double size = 1e-9; size < 1e6; size *= 1.3) x.push_back(static_cast<float>(size)), x.push_back(static_cast<float>(-size));
  const Activated found = activate(Activation::softplus, x);
  std::vector<double> value, slope;
  for (const float at : x) value.push_back(reference::activate(reference::Activation::softplus, at)), slope.push_back(reference::activate_derivative(reference::Activation::softplus, at));
  expect_that(Row::softplus, Way::forward, "x = −1e6 and 1e6", "0 and 1e6", found.value[0] == 0 && found.value[1] == 1e6);
  expect_that(Row::softplus, Way::backward, "x = −1e6 and 1e6", "slopes 0 and 1", found.slope[0] == 0 && found.slope[1] == 1);
  // Vulkan's log is 2^-21 off near 1; over β = 100 that is 5e-9.
  expect_within(Row::softplus, Way::forward, "|x| from 1e-9 to 1e6, both signs", "error / (0.05 + |value|)", largest_error(found.value, value, 0.05), 4e-7);
  expect_within(Row::softplus, Way::backward, "|x| from 1e-9 to 1e6, both signs", "error of the slope", largest_error(found.slope, slope, 1), float32_bound);
}

TEST_F(NetworkExtremes, SinesOfPhasesToTenThousand) {
  std::vector<float> x = uniform(4096, -1e4, 1e4);
  x.insert(x.end(), {-1e4F, 1e4F, 0, -0.0F});
  for (int i = 0; i < 3183; i += 7)  // next to the multiples of π, where sin loses most, and between them, where cos does
    for (const double half : {0.0, 0.5}) x.push_back(static_cast<float>((i + half) * std::numbers::pi));
  const Activated found = activate(Activation::sine, x);
  std::vector<double> sine, cosine;
  for (const float at : x) sine.push_back(static_cast<double>(std::sin(static_cast<long double>(at)))), cosine.push_back(static_cast<double>(std::cos(static_cast<long double>(at))));
  double sine_error = 0, cosine_error = 0;
  for (size_t i = 0; i < x.size(); ++i) sine_error = std::max(sine_error, std::abs(found.value[i] - sine[i])), cosine_error = std::max(cosine_error, std::abs(found.slope[i] - cosine[i]));
  ASSERT_TRUE(all_finite(found.value) && all_finite(found.slope));
  expect_within(Row::sines, Way::forward, "phases from −1e4 to 1e4 rad", "error of the sine", sine_error, 2e-7);
  expect_within(Row::sines, Way::backward, "phases from −1e4 to 1e4 rad", "error of the slope", cosine_error, 2e-7);
}

TEST_F(NetworkExtremes, ActivationsHandNotANumberOn) {
  for (const auto& [activation, name] : {std::pair{Activation::none, "none"}, {Activation::relu, "ReLU"}, {Activation::leaky_relu, "leaky ReLU"}, {Activation::softplus, "softplus"}, {Activation::sine, "sine"}, {Activation::sigmoid, "sigmoid"}}) {
    const Activated found = activate(activation, {not_a_number, -not_a_number, 1}, true);
    expect_that(Row::not_a_number, Way::forward, fmt::format("activation {} of NaN of either sign", name), "NaN", std::isnan(found.value[0]) && std::isnan(found.value[1]) && !std::isnan(found.value[2]));
  }
}

TEST_F(NetworkExtremes, ActivationsOfDenormals) {
  const std::vector<float> x = {1e-40F, -1e-40F, 1e-38F, -1e-38F};
  for (const auto& [activation, of_double, name] : {std::tuple{Activation::relu, reference::Activation::relu, "ReLU"}, {Activation::leaky_relu, reference::Activation::leaky_relu, "leaky ReLU"}, {Activation::softplus, reference::Activation::softplus, "softplus"}, {Activation::sine, reference::Activation::sine, "sine"}, {Activation::sigmoid, reference::Activation::sigmoid, "sigmoid"}}) {
    const Activated found = activate(activation, x);
    std::vector<double> value, slope;
    for (const float at : x) value.push_back(reference::activate(of_double, at)), slope.push_back(reference::activate_derivative(of_double, at));
    const bool kink = activation == Activation::relu || activation == Activation::leaky_relu;
    const auto limit = [&](size_t i) { return found.slope[i] == slope[i] || found.slope[i] == (activation == Activation::relu ? 0 : 0.2F); };
    expect_within(Row::denormals, Way::forward, fmt::format("{} of ±1e-40 and ±1e-38", name), "error", largest_error(found.value, value, 1), 1e-7);
    if (kink) expect_that(Row::denormals, Way::backward, fmt::format("{} of ±1e-40 and ±1e-38", name), "the slope there, or that at 0", limit(0) && limit(1) && limit(2) && limit(3));
    else expect_within(Row::denormals, Way::backward, fmt::format("{} of ±1e-40 and ±1e-38", name), "error of the slope", largest_error(found.slope, slope, 1), float32_bound);
  }
}

// A rig of `parents` whose logits are given row by row [rows][logits], before the factor 20.
struct Skinned {
  std::vector<double> weights, posed, d_logits;              // found
  std::vector<double> weights_truth, posed_truth, d_logits_truth;
};

class SkinningExtremes : public DeviceTest {
 protected:
  Skinned skin(const std::vector<int>& parents, const std::vector<double>& logits) {
    const JointTree tree(parents);
    const reference::JointTree truth_tree(parents);
    const uint32_t width = tree.logits(), joints = tree.joints(), rows = static_cast<uint32_t>(logits.size() / width), padded = padded_points(rows);
    const uint32_t stride = padded_channels(width), weight_stride = padded_channels(joints);
    const std::vector<double> bones = random_bones(generator, joints, 1.5);
    const auto random = [&](size_t count) { const std::vector<float> values = uniform(count); return std::vector<double>(values.begin(), values.end()); };
    const std::vector<double> x = random(3 * rows), g = random(3 * rows);
    const std::vector<FrameConstants> constants = {frame_constants({}, bones)};
    Buffer frame = filled("frame", constants), logit_rows = filled("logits", padded_rows(logits, width, stride)), canonical = filled("canonical", padded_rows(x, 3, 4)), cotangents = filled("cotangents", padded_rows(g, 3, 4)),
           posed = empty("posed", padded * 16ull), weights = empty("weights", padded * 4ull * weight_stride), d_logits = empty("d logits", padded * 4ull * stride), d_canonical = empty("d canonical", padded * 16ull),
           transforms = empty("transforms", padded * 48ull);
    const Rows over{{rows, {}}, {}};
    record_lbs(commands, {&tree, over, {logit_rows.slice(), stride, 0}, frame.slice(), canonical.slice(), posed.slice(), transforms.slice(), {weights.slice(), weight_stride, 0}});
    record_lbs_backward(commands, {&tree, over, {logit_rows.slice(), stride, 0}, frame.slice(), canonical.slice(), cotangents.slice(), 3, {d_logits.slice(), stride, 0}, d_canonical.slice()});
    commands.submit_and_wait();
    std::vector<double> scaled = logits;
    for (double& value : scaled) value = 20 * static_cast<double>(static_cast<float>(value));
    Skinned result;
    result.weights = rows_of(device.download<float>(weights.slice()), rows, joints, weight_stride);
    result.posed = rows_of(device.download<float>(posed.slice()), rows, 3, 4);
    result.d_logits = rows_of(device.download<float>(d_logits.slice()), rows, width, stride);
    result.weights_truth = reference::hierarchical_softmax_forward(truth_tree, rows, scaled);
    result.posed_truth = reference::lbs_forward(rows, result.weights_truth, bones, x);
    const reference::LbsGradients back = reference::lbs_backward(rows, result.weights_truth, bones, x, g, {});
    result.d_logits_truth = reference::hierarchical_softmax_backward(truth_tree, rows, scaled, back.weights);
    for (double& value : result.d_logits_truth) value *= 20;
    return result;
  }
};

TEST_F(SkinningExtremes, LogitsOfTenThousand) {
  const uint32_t width = JointTree(smpl_tree()).logits();
  std::vector<double> random, signs;
  for (const float value : uniform(130 * width, -1e4, 1e4)) random.push_back(value), signs.push_back(value > 0 ? 1e4 : -1e4);
  for (const auto& [logits, name] : {std::pair{random, "24 joints, logits at random within ±1e4"}, {signs, "24 joints, logits of ±1e4, many of them equal"}}) {
    const Skinned skinned = skin(smpl_tree(), logits);
    double sum_error = 0;
    for (size_t r = 0; r < 130; ++r) {
      double sum = 0;
      for (size_t j = 0; j < 24; ++j) sum += skinned.weights[24 * r + j];
      sum_error = std::max(sum_error, std::abs(sum - 1));
    }
    expect_within(Row::logits, Way::forward, std::string(name) + ": Σ weights", "error of 1", sum_error, 1e-6);
    expect_within(Row::logits, Way::forward, std::string(name) + ": weights", "error", largest_error(skinned.weights, skinned.weights_truth, 1), 1e-5);
    expect_within(Row::logits, Way::backward, std::string(name) + ": dL/dlogits", "error, of 1 plus it", largest_error(skinned.d_logits, skinned.d_logits_truth, 1), 1e-5);
  }
}

TEST_F(SkinningExtremes, OneJointAndSixtyFour) {
  for (const auto& [parents, name] : {std::pair{std::vector<int>{-1}, "one joint"}, {random_tree(generator, 64, 1), "64 joints in a chain"}, {std::vector<int>(64, 0), "63 joints on one"}}) {
    std::vector<int> tree = parents;
    tree[0] = -1;
    const uint32_t width = JointTree(tree).logits();
    std::vector<double> logits;
    for (const float value : uniform(65 * width, -0.2, 0.2)) logits.push_back(value);
    const Skinned skinned = skin(tree, logits);
    expect_within(Row::counts, Way::forward, std::string(name) + ": skinning weights", "error", largest_error(skinned.weights, skinned.weights_truth, 1), 1e-6);
    expect_within(Row::counts, Way::forward, std::string(name) + ": posed points", "error, metres", largest_error(skinned.posed, skinned.posed_truth, 1), 4e-6);
    expect_within(Row::counts, Way::backward, std::string(name) + ": dL/dlogits", "error, of 1 plus it", largest_error(skinned.d_logits, skinned.d_logits_truth, 1), 1e-5);
  }
  expect_error<std::invalid_argument>(Row::counts, Way::forward, "65 joints", {"64", "65"}, [] { JointTree(std::vector<int>(65, 0)); });
}

TEST_F(SkinningExtremes, NotANumberAmongTheLogits) {
  const uint32_t width = JointTree(smpl_tree()).logits();
  for (const auto& [bad, name] : {std::pair{not_a_number, "NaN"}, {infinity, "infinity"}}) {
    std::vector<double> logits(2 * width, 0.01);
    logits[width / 2] = bad;
    const Skinned skinned = skin(smpl_tree(), logits);
    expect_that(Row::not_a_number, Way::forward, fmt::format("{} among the logits", name), "NaN in its posed point, and there alone", std::isnan(skinned.posed[0]) && std::isfinite(skinned.posed[3]));
    expect_that(Row::not_a_number, Way::backward, fmt::format("{} among the logits", name), "NaN in its dL/dlogits", std::isnan(skinned.d_logits[1]) && std::isfinite(skinned.d_logits[width + 1]));
  }
}

TEST_F(SkinningExtremes, DenormalLogits) {
  const uint32_t width = JointTree(smpl_tree()).logits();
  const Skinned skinned = skin(smpl_tree(), std::vector<double>(width, 1e-40));
  expect_within(Row::denormals, Way::forward, "logits of 1e-40: skinning weights", "error", largest_error(skinned.weights, skinned.weights_truth, 1), 1e-6);
  expect_within(Row::denormals, Way::backward, "logits of 1e-40: dL/dlogits", "error, of 1 plus it", largest_error(skinned.d_logits, skinned.d_logits_truth, 1), 1e-5);
}

class LossExtremes : public DeviceTest {
 protected:
  // Of gradients of the field, [points][3]: unit normals, and value and gradient of the eikonal and the normal loss (with the normal z).
  struct OfGradients {
    std::vector<double> normals, d_eikonal, d_normal;
    double eikonal = 0, normal = 0;
  };
  OfGradients of_gradients(const std::vector<float>& gradients) {
    const uint32_t points = static_cast<uint32_t>(gradients.size() / 3), padded = padded_points(points);
    std::vector<float> rows(8ull * padded, 0.0F), outward(4ull * padded, 0.0F);
    for (size_t i = 0; i < points; ++i) {
      for (size_t c = 0; c < 3; ++c) rows[8 * i + c] = gradients[3 * i + c];
      outward[4 * i + 2] = 1;
    }
    Buffer g = filled("gradients", rows), n = filled("outward", outward), normals = empty("normals", 16ull * padded), d_eikonal = filled("d eikonal", std::vector<float>(8ull * padded, 0.0F)),
           d_normal = filled("d normal", std::vector<float>(8ull * padded, 0.0F)), losses = filled("losses", std::vector<float>(64, 0.0F)), partials = empty("partials", std::max<uint64_t>(partial_bytes(points), 256));
    record_posed_normals(commands, {points, {g.slice(), 8, 0}, {}, normals.slice(), true});
    record_eikonal_loss(commands, {points, 1, 1, {g.slice(), 8, 0}, {d_eikonal.slice(), 8, 0}, 8, losses.slice(), 0, partials.slice()});
    record_normal_loss(commands, {points, 1, 1, {g.slice(), 8, 0}, n.slice(), {d_normal.slice(), 8, 0}, losses.slice(), 1, partials.slice()});
    commands.submit_and_wait();
    const std::vector<float> sums = device.download<float>(losses.slice());
    return {rows_of(device.download<float>(normals.slice()), points, 3, 4), rows_of(device.download<float>(d_eikonal.slice()), points, 3, 8), rows_of(device.download<float>(d_normal.slice()), points, 3, 8), sums[0], sums[1]};
  }

  struct OfRays {
    double color = 0, alpha = 0;
    std::vector<double> gradient;  // [rays][4]
  };
  OfRays image_loss(const std::vector<float>& colors, const std::vector<float>& targets) {
    const uint32_t rays = static_cast<uint32_t>(colors.size() / 4);
    Buffer c = filled("colours", colors), t = filled("targets", targets), d = empty("d colours", 16ull * padded_points(rays)), losses = filled("losses", std::vector<float>(64, 0.0F)), partials = empty("partials", std::max<uint64_t>(partial_bytes(rays, 2), 256));
    record_image_loss(commands, {rays, static_cast<float>(rays), 1, 1, c.slice(), t.slice(), d.slice(), losses.slice(), 0, partials.slice()});
    commands.submit_and_wait();
    const std::vector<float> sums = device.download<float>(losses.slice());
    return {sums[0], sums[1], rows_of(device.download<float>(d.slice()), rays, 4, 4)};
  }
};

// The largest and the least numbers of float32 that are not denormal.
TEST_F(LossExtremes, NormalsOfEveryLength) {
  std::vector<float> gradients;
  std::vector<double> directions, d_normal;
  for (const double size : {1e-37, 1e-30, 1e-21, 1e-19, 1e-9, 1.0, 1e9, 1e18, 1e20, 1e38})
    for (const float value : {-0.48F, 0.6F, 0.64F}) gradients.push_back(static_cast<float>(size * double{value}));
  for (size_t i = 0; i < gradients.size() / 3; ++i) {
    const double x = gradients[3 * i], y = gradients[3 * i + 1], z = gradients[3 * i + 2], size = std::hypot(x, y, z);
    for (const double value : {x, y, z}) directions.push_back(value / size);
    for (size_t c = 0; c < 3; ++c) d_normal.push_back((z / size * directions[3 * i + c] - (c == 2)) / size);
  }
  const OfGradients found = of_gradients(gradients);
  std::vector<double> pulled = directions;  // the eikonal loss's gradient: towards length 1
  for (size_t i = 0; i < pulled.size(); ++i) pulled[i] *= i < 15 ? -1 : 1;
  std::vector<double> d_eikonal = found.d_eikonal;
  for (size_t i = 15; i < 18; ++i) pulled[i] = d_eikonal[i];  // at length 1 the sign is rounding's
  const char* const name = "∇f of length 1e-37 to 1e38";
  expect_within(Row::denormals, Way::forward, std::string(name) + ": unit normal", "error", largest_error(found.normals, directions, 1), 1e-6);
  expect_within(Row::denormals, Way::backward, std::string(name) + ": gradient of the eikonal loss", "error", largest_error(d_eikonal, pulled, 1), 1e-6);
  // In units of 1 / |∇f|, which is what it grows with.
  double error = 0;
  for (size_t i = 0; i < d_normal.size(); ++i) {
    const double size = std::hypot(gradients[i / 3 * 3], gradients[i / 3 * 3 + 1], gradients[i / 3 * 3 + 2]);
    error = std::max(error, std::isfinite(found.d_normal[i]) ? std::max(std::abs(found.d_normal[i] - d_normal[i]) - 1e-37, 0.0) * size : std::nan(""));
    if (!std::isfinite(found.d_normal[i])) error = std::nan("");
  }
  expect_within(Row::denormals, Way::backward, std::string(name) + ": gradient of the normal loss", "error times |∇f|", error, 1e-6);

  const OfGradients zero = of_gradients({0, 0, 0});
  expect_that(Row::denormals, Way::forward, "∇f = 0", "a zero normal, eikonal loss 1, normal loss 1", all_zero(zero.normals) && zero.eikonal == 1 && zero.normal == 1);
  expect_that(Row::denormals, Way::backward, "∇f = 0", "no gradient of either loss", all_zero(zero.d_eikonal) && all_zero(zero.d_normal));
  const OfGradients denormal = of_gradients({-3e-41F, 4e-41F, 0});
  const auto unit_or_zero = [](std::span<const double> v, double sign) { return all_zero(v) || (std::abs(v[0] + sign * 0.6) < 1e-3 && std::abs(v[1] - sign * 0.8) < 1e-3); };
  expect_that(Row::denormals, Way::forward, "∇f = (−3e-41, 4e-41, 0)", "a normal of (−0.6, 0.8, 0), or zero where denormals are", unit_or_zero(denormal.normals, 1));
  expect_that(Row::denormals, Way::backward, "∇f = (−3e-41, 4e-41, 0)", "an eikonal gradient of (0.6, −0.8, 0), or zero where denormals are", unit_or_zero(denormal.d_eikonal, -1));

  const OfGradients bad = of_gradients({not_a_number, 1, 0, 0, 0, 1});
  expect_that(Row::not_a_number, Way::forward, "∇f with a NaN", "NaN in its normal and in the eikonal loss", std::isnan(bad.normals[1]) && std::isfinite(bad.normals[5]) && std::isnan(bad.eikonal));
  expect_that(Row::not_a_number, Way::backward, "∇f with a NaN", "NaN in its gradient of the eikonal loss", std::isnan(bad.d_eikonal[1]) && std::isfinite(bad.d_eikonal[5]));
}

// Rendered Σ weights of 0, 1 and between against masks that are 0 or 1 throughout.
TEST_F(LossExtremes, MasksOfOneKind) {
  const std::vector<double> sums = {0, 1e-30, 5e-4, 0.3, 0.9995, 1};
  for (const double mask : {0.0, 1.0}) {
    std::vector<float> colors, targets;
    for (const double sum : sums) {
      colors.insert(colors.end(), {0.25F, 0.5F, 0.75F, static_cast<float>(sum)});
      targets.insert(targets.end(), {static_cast<float>(mask), static_cast<float>(mask), static_cast<float>(mask), static_cast<float>(mask)});
    }
    const OfRays found = image_loss(colors, targets);
    std::vector<double> wide;
    for (size_t i = 0; i < sums.size(); ++i) wide.push_back(colors[4 * i + 3]);
    const reference::ScalarLoss truth = reference::alpha_loss(wide, std::vector<double>(sums.size(), mask), static_cast<double>(sums.size()), {});
    std::vector<double> d_alpha;
    for (size_t i = 0; i < sums.size(); ++i) d_alpha.push_back(found.gradient[4 * i + 3]);
    const std::string name = mask == 0 ? "mask black throughout" : "mask all foreground";
    expect_within(Row::masks, Way::forward, name + ": cross entropy of Σ weights 0 to 1", "relative error", std::abs(found.alpha / truth.value - 1), 1e-5);
    expect_within(Row::masks, Way::backward, name + ": its gradient", "error, of the largest", error_of_largest(d_alpha, truth.gradient), 1e-5);
    expect_that(Row::masks, Way::backward, name + ": its gradient at Σ weights 0 and 1, beyond the clamp", "0", d_alpha.front() == 0 && d_alpha.back() == 0);
  }
  const OfRays none = image_loss({0.5F, 0.5F, 0.5F, 0.5F}, {1, 1, 1, -1});
  expect_that(Row::masks, Way::forward, "no ray in the loss (its mask unknown)", "losses 0", none.color == 0 && none.alpha == 0);
  expect_that(Row::masks, Way::backward, "no ray in the loss (its mask unknown)", "gradient 0", all_zero(none.gradient));

  const OfRays bad = image_loss({not_a_number, 0, 0, not_a_number, 0.5F, 0.5F, 0.5F, 0.5F}, {1, 1, 1, 1, 0, 0, 0, 0});
  expect_that(Row::not_a_number, Way::forward, "a rendered colour and Σ weights of NaN", "NaN in both losses", std::isnan(bad.color) && std::isnan(bad.alpha));
  expect_that(Row::not_a_number, Way::backward, "a rendered colour and Σ weights of NaN", "NaN in their gradients alone", std::isnan(bad.gradient[0]) && std::isnan(bad.gradient[3]) && std::isfinite(bad.gradient[1]) && std::isfinite(bad.gradient[4]));
}

// The mask loss of surface rendering where the least distance is far in or out.
TEST_F(LossExtremes, MasksOfOneKindInSurfaceRendering) {
  for (const float mask : {0.0F, 1.0F})
    for (const float alpha : {50.0F, 1e4F}) {
      const std::vector<double> f = {-1e6, -1, -1e-9, 0, 1e-9, 1, 1e6};
      std::vector<float> rows(8 * 64, 0.0F), points(4 * 64, 1.0F), masks(64, mask);
      for (size_t i = 0; i < f.size(); ++i) rows[8 * i] = static_cast<float>(f[i]);
      const uint32_t rays = static_cast<uint32_t>(f.size());
      Buffer sdf = filled("sdf", rows), p = filled("points", points), m = filled("masks", masks), d = empty("d sdf", 8 * 64 * 4), losses = filled("losses", std::vector<float>(64, 0.0F)), partials = empty("partials", 512);
      record_mask_loss(commands, {rays, 1, 1, alpha, {sdf.slice(), 8, 0}, p.slice(), m.slice(), {d.slice(), 8, 0}, 8, losses.slice(), 0, partials.slice(), {}});
      commands.submit_and_wait();
      std::vector<double> wide;
      for (const double value : f) wide.push_back(static_cast<float>(value));
      const reference::MaskLoss truth = reference::mask_loss(wide, std::vector<double>(f.size(), mask), alpha, 1, {});
      const std::string name = fmt::format("{}, least distances −1e6 to 1e6, α = {:g}", mask == 0 ? "mask black throughout" : "mask all foreground", alpha);
      expect_within(Row::masks, Way::forward, name, "relative error", std::abs(device.download<float>(losses.slice())[0] / truth.value - 1), 1e-6);
      expect_within(Row::masks, Way::backward, name, "error of the slope", largest_error(rows_of(device.download<float>(d.slice()), rays, 1, 8), truth.gradient, 1), float32_bound);
    }
}

// Points outside of which the network says that they lie inside, and points inside of which it says that they lie outside.
TEST_F(LossExtremes, PenaltiesOfDistances) {
  struct Penalised {
    std::vector<double> value, slope;
  };
  // One distance a launch has a loss of its own.
  const auto penalised = [&](SdfPenalty kind, const std::vector<float>& distances) {
    Penalised found;
    for (const float distance : distances) {
      Buffer sdf = filled("sdf", std::vector<float>(8, distance)), d = filled("d sdf", std::vector<float>(8 * 64, 0.0F)), losses = filled("losses", std::vector<float>(64, 0.0F)), partials = empty("partials", 256);
      record_sdf_penalty(commands, {kind, 1, 1, 1, {sdf.slice(), 8, 0}, {d.slice(), 8, 0}, 8, losses.slice(), 0, partials.slice()});
      commands.submit_and_wait();
      found.value.push_back(device.download<float>(losses.slice())[0]), found.slope.push_back(device.download<float>(d.slice())[0]);
    }
    return found;
  };
  constexpr long double least = 1e-34L;  // 5000 times what float32 has no digits for
  const auto keep = [](double& largest, double found, long double truth, long double size) {
    const double error = static_cast<double>(std::max(std::abs(found - truth) - least, 0.0L) / ((std::abs(truth) + least) * (1 + size)));
    if (!(error <= largest)) largest = error;
  };

  std::vector<float> within = {0, -0.2F, -0.8F, 1, 1e6F}, all = {-0.9F, -1, -1e6F}, beyond = {-0.9F, -1, -10, -1e6F};
  for (double size = 1e-6; size < 1e6; size *= 1.25) {
    within.push_back(static_cast<float>(size)), all.push_back(static_cast<float>(-size));
    if (size < 0.8) within.push_back(static_cast<float>(-size));
  }
  all.insert(all.end(), within.begin(), within.end());

  double error = 0, slope_error = 0;
  const Penalised outside = penalised(SdfPenalty::off_surface, within);
  for (size_t i = 0; i < within.size(); ++i) {
    const long double t = -100 * static_cast<long double>(within[i]), size = std::min(std::abs(t), 90.0L);
    keep(error, outside.value[i], std::exp(t), size), keep(slope_error, outside.slope[i], -100 * std::exp(t), size);
  }
  const char* const name = "points outside, e^(−100 f), f from −0.8 to 1e6";
  expect_within(Row::penalties, Way::forward, name, "relative error / (1 + 100 |f|), against long double", error, float32_bound);
  expect_within(Row::penalties, Way::backward, name, "relative error / (1 + 100 |f|), against long double", slope_error, float32_bound);
  const Penalised lost = penalised(SdfPenalty::off_surface, beyond);
  const auto infinite = [](double value) { return std::isinf(value); };
  expect_that(Row::penalties, Way::forward, "points outside, f from −0.9 down to −1e6", "infinite: training stops there", std::all_of(lost.value.begin(), lost.value.end(), infinite));
  expect_that(Row::penalties, Way::backward, "points outside, f from −0.9 down to −1e6", "infinite: training stops there", std::all_of(lost.slope.begin(), lost.slope.end(), infinite));

  error = slope_error = 0;
  const Penalised inside = penalised(SdfPenalty::inside, all);
  for (size_t i = 0; i < all.size(); ++i) {
    const long double x = 5000 * static_cast<long double>(all[i]), size = std::min(std::abs(x), 90.0L), tail = std::exp(-std::abs(x));
    keep(error, inside.value[i], (x > 0 ? 1 : tail) / (1 + tail), size), keep(slope_error, inside.slope[i], 5000 * tail / ((1 + tail) * (1 + tail)), size);
  }
  expect_within(Row::penalties, Way::forward, "points inside, sigmoid(5000 f), f from −1e6 to 1e6", "relative error / (1 + 5000 |f|), against long double", error, float32_bound);
  expect_within(Row::penalties, Way::backward, "points inside, sigmoid(5000 f), f from −1e6 to 1e6", "relative error / (1 + 5000 |f|), against long double", slope_error, float32_bound);

  const Penalised bad = penalised(SdfPenalty::off_surface, {not_a_number});
  expect_that(Row::not_a_number, Way::forward, "a distance of NaN outside the body", "NaN in the penalty", std::isnan(bad.value[0]));
  expect_that(Row::not_a_number, Way::backward, "a distance of NaN outside the body", "NaN in its gradient", std::isnan(bad.slope[0]));
}

// Gradients down to denormals: the step is then Adam's ε's, and nothing is divided by 0.
TEST_F(LossExtremes, AdamAtDenormals) {
  std::vector<float> gradient(64, 0.0F);
  const std::vector<float> sizes = {1e-45F, 1e-40F, 1e-30F, 1e-20F, 1e-10F, 1.0F, 1e10F, 1e18F};
  std::copy(sizes.begin(), sizes.end(), gradient.begin());
  const std::vector<float> zeros(64, 0.0F);
  Buffer p = filled("parameters", zeros), g = filled("gradient", gradient), m = filled("m", zeros), v = filled("v", zeros);
  AdamArgs args;
  args.rate = 1e-3;
  const auto range = [](Buffer& buffer) { return buffer.slice().elements(0, 64); };
  args.parameters = range(p), args.gradients = range(g), args.first_moments = range(m), args.second_moments = range(v);
  record_adam(commands, args);
  commands.submit_and_wait();
  const std::vector<float> moved = device.download<float>(range(p));
  std::vector<double> found(moved.begin(), moved.begin() + static_cast<long>(sizes.size())), truth;
  for (const float size : sizes) truth.push_back(-1e-3 * double{size} / (double{size} + 1e-8));
  expect_within(Row::denormals, Way::backward, "Adam's first step of gradients of 1e-45 to 1e18", "error, of the rate", largest_error(found, truth, 1) / 1e-3, 1e-5);
}

}  // namespace
}  // namespace arah
