#include "kernels/reference/losses.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/golden.h"
#include "tests/kernels/reference/matrix_rows.h"
#include "tests/kernels/reference/finite_differences.h"

namespace arah::reference {
namespace {

std::vector<Rgb> triples(const std::vector<double>& numbers) {
  std::vector<Rgb> result(numbers.size() / 3);
  for (std::size_t i = 0; i < numbers.size(); ++i) result[i / 3][i % 3] = numbers[i];
  return result;
}

// Numbers in [from, to).
std::vector<double> random_numbers(std::size_t count, double from, double to, unsigned seed) {
  std::vector<double> numbers = random_values(count, (to - from) / 2, seed);
  for (double& number : numbers) number += (from + to) / 2;
  return numbers;
}

TEST(Losses, Golden09) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("09_losses");
  const auto rgb = triples(truth.values("in.rgb")), photograph = triples(truth.values("in.gt"));
  const double rays = static_cast<double>(rgb.size());
  const ColorLoss color = color_loss(rgb, photograph, truth.tensor("in.net_mask").as<std::uint8_t>(), rays);
  const EikonalLoss eikonal = eikonal_loss(triples(truth.values("in.grad")), rays);
  const ScalarLoss off = off_surface_loss(truth.values("in.off"), rays);
  const ScalarLoss inside = inside_loss(truth.values("in.inside"), rays);
  const ScalarLoss skinning = skinning_loss(truth.values("in.w"), truth.values("in.w_gt"), 24);
  std::vector<double> parameters;
  for (const char* name : {"in.p0", "in.p1", "in.p2"}) {
    const auto part = truth.values(name);
    parameters.insert(parameters.end(), part.begin(), part.end());
  }
  const ScalarLoss regulariser = parameter_loss(parameters);

  golden::expect_golden(truth, "out.colour", color.value);
  golden::expect_golden(truth, "out.eikonal", eikonal.value);
  golden::expect_golden(truth, "out.off", off.value);
  golden::expect_golden(truth, "out.inside", inside.value);
  golden::expect_golden(truth, "out.skinning", skinning.value);
  golden::expect_golden(truth, "out.params", regulariser.value);
  golden::expect_golden(truth, "out.total",
                        30 * color.value + 50 * eikonal.value + 100 * off.value + 10 * inside.value +
                            10 * skinning.value + 100 * regulariser.value);
  golden::expect_golden(truth, "grad.rgb", flat(color.gradient));
  golden::expect_golden(truth, "grad.grad", flat(eikonal.gradient));
  golden::expect_golden(truth, "grad.off", off.gradient);
  golden::expect_golden(truth, "grad.inside", inside.gradient);
  golden::expect_golden(truth, "grad.w", skinning.gradient);
  auto begin = regulariser.gradient.begin();
  for (const char* name : {"grad.p0", "grad.p1", "grad.p2"}) {
    const auto end = begin + truth.tensor(name).count();
    golden::expect_golden(truth, name, std::vector<double>(begin, end));
    begin = end;
  }
}

TEST(Losses, GradientsAgreeWithDifferences) {
  const double rays = 13;  // N is not the number of points
  std::vector<double> x = random_numbers(21, -1, 1, 1);
  const std::vector<double> y = random_numbers(21, -1, 1, 2);
  const std::vector<std::uint8_t> mask{1, 0, 1, 1, 0, 1, 1};
  expect_gradient(
      "colour", [&] { return color_loss(triples(x), triples(y), mask, rays).value; }, x,
      flat(color_loss(triples(x), triples(y), mask, rays).gradient));
  const std::vector<double> weights = random_numbers(11, 0.1, 2, 7);
  expect_gradient(
      "colour by ray weights", [&] { return color_loss(triples(x), triples(y), mask, rays, std::span(weights).first(7)).value; }, x,
      flat(color_loss(triples(x), triples(y), mask, rays, std::span(weights).first(7)).gradient));
  expect_gradient(
      "eikonal", [&] { return eikonal_loss(triples(x), rays).value; }, x,
      flat(eikonal_loss(triples(x), rays).gradient));
  expect_gradient(
      "skinning", [&] { return skinning_loss(x, y, 3).value; }, x, skinning_loss(x, y, 3).gradient);
  expect_gradient(
      "parameters", [&] { return parameter_loss(x).value; }, x, parameter_loss(x).gradient);
  std::vector<double> outside = random_numbers(9, -0.01, 0.05, 3);
  expect_gradient(
      "off-surface", [&] { return off_surface_loss(outside, rays).value; }, outside,
      off_surface_loss(outside, rays).gradient, 1e-5);
  std::vector<double> near_zero = random_numbers(9, -1e-3, 1e-3, 4);
  expect_gradient(
      "inside", [&] { return inside_loss(near_zero, rays).value; }, near_zero, inside_loss(near_zero, rays).gradient,
      2e-7);
  std::vector<double> distances = random_numbers(9, -0.03, 0.03, 8);
  expect_gradient(
      "on the surface", [&] { return on_surface_loss(distances, rays).value; }, distances, on_surface_loss(distances, rays).gradient);
  expect_gradient(
      "near zero", [&] { return near_zero_loss(distances, rays).value; }, distances, near_zero_loss(distances, rays).gradient, 1e-5);
  std::vector<Rgb> normals = triples(random_numbers(21, -1, 1, 9));
  for (Rgb& n : normals) {
    const double length = std::hypot(n[0], n[1], n[2]);
    for (double& axis : n) axis /= length;
  }
  expect_gradient(
      "normals", [&] { return normal_loss(triples(x), normals, rays).value; }, x, flat(normal_loss(triples(x), normals, rays).gradient));
  std::vector<double> sums = random_numbers(11, 0.01, 0.99, 5);
  const std::vector<double> soft_mask = random_numbers(11, 0, 1, 6);
  expect_gradient(
      "alpha", [&] { return alpha_loss(sums, soft_mask, rays).value; }, sums,
      alpha_loss(sums, soft_mask, rays).gradient);
  expect_gradient(
      "alpha by ray weights", [&] { return alpha_loss(sums, soft_mask, rays, weights).value; }, sums,
      alpha_loss(sums, soft_mask, rays, weights).gradient);
}

// Twice a ray's weight is that ray twice.
TEST(Losses, MaskTermAgreesWithDifferencesInDistanceAndAlpha) {
  std::vector<double> sdf = random_numbers(40, -0.1, 0.1, 61), mask = random_numbers(40, 0, 1, 62), weights = random_numbers(40, 0.2, 2, 63), alpha{37};
  for (std::size_t i = 0; i < 20; ++i) mask[i] = i % 2 ? 1.0 : 0.0;
  const auto loss = [&] { return mask_loss(sdf, mask, alpha[0], 23, weights).value; };
  const MaskLoss at = mask_loss(sdf, mask, alpha[0], 23, weights);
  expect_gradient("mask term, distances", loss, sdf, at.gradient);
  expect_gradient("mask term, alpha", loss, alpha, std::vector<double>{at.d_alpha}, 1e-2);
  EXPECT_LT(at.d_alpha, 0) << "it falls as alpha grows";

  // Far out of the person's mask, or deep inside it, there is nothing to learn; on the wrong side the slope is ± 1 and the value
  // the distance, without overflow.
  const std::vector<double> far{1e3, -1e3, 1e3, -1e3}, masks{0, 1, 1, 0};
  const MaskLoss ends = mask_loss(far, masks, 50, 1);
  EXPECT_EQ(ends.gradient, (std::vector<double>{0, 0, 1, -1}));
  EXPECT_DOUBLE_EQ(ends.value, 2e3);
  // On the surface: ln 2 / alpha.
  EXPECT_NEAR(mask_loss(std::vector<double>{0.0}, std::vector<double>{1.0}, 50, 1).value, std::log(2.0) / 50, 1e-15);
}

TEST(Losses, ARaysWeightCountsItSoOften) {
  const std::vector<Rgb> rendered{{0.1, 0.5, 0.9}, {0.4, 0.4, 0.2}}, photograph{{0.3, 0.3, 0.3}, {0.9, 0.1, 0.2}};
  const std::vector<std::uint8_t> mask{1, 1, 1};
  const std::vector<double> weights{2, 1}, sums{0.3, 0.8}, person{1, 0};
  const std::vector<Rgb> twice{rendered[0], rendered[0], rendered[1]}, photographs{photograph[0], photograph[0], photograph[1]};
  EXPECT_DOUBLE_EQ(color_loss(rendered, photograph, mask, 5, weights).value, color_loss(twice, photographs, mask, 5).value);
  EXPECT_DOUBLE_EQ(alpha_loss(sums, person, 5, weights).value, alpha_loss(std::vector{0.3, 0.3, 0.8}, std::vector{1.0, 1.0, 0.0}, 5).value);
}

TEST(Losses, KinksAndEmptyInputsHaveNoGradient) {
  const EikonalLoss eikonal = eikonal_loss(std::vector<Rgb>{{0, 0, 0}, {0, 1, 0}, {1e200, 0, 0}}, 4);
  EXPECT_EQ(eikonal.gradient[0], (Rgb{0, 0, 0}));
  EXPECT_EQ(eikonal.gradient[1], (Rgb{0, 0, 0}));
  EXPECT_EQ(eikonal.gradient[2], (Rgb{0.25, 0, 0}));
  EXPECT_EQ(parameter_loss(std::vector<double>(5, 0.0)).gradient, std::vector<double>(5, 0.0));
  EXPECT_EQ(parameter_loss({}).value, 0);
  EXPECT_EQ(color_loss({}, {}, {}, 2048).value, 0);
  EXPECT_EQ(skinning_loss({}, {}, 24).value, 0);
}

// By hand: what pre-training's terms are where all is right, and where it is wrong.
TEST(Losses, TermsOfThePretraining) {
  EXPECT_EQ(on_surface_loss(std::vector{0.0, -0.5, 0.25}, 2).value, 0.375);
  EXPECT_EQ(on_surface_loss(std::vector{0.0, -0.5, 0.25}, 2).gradient, (std::vector{0.0, -0.5, 0.5}));
  EXPECT_DOUBLE_EQ(near_zero_loss(std::vector{0.0, 0.01, -0.01, 9.0}, 1).value, 1 + 2 * std::exp(-1.0));
  EXPECT_EQ(near_zero_loss(std::vector{0.0}, 1).gradient[0], 0);
  const std::vector<Rgb> up{{0, 1, 0}, {0, 1, 0}, {0, 1, 0}, {0, 1, 0}}, gradients{{0, 3, 0}, {0, -3, 0}, {2, 0, 0}, {0, 0, 0}};
  const EikonalLoss loss = normal_loss(gradients, up, 1);
  EXPECT_EQ(loss.value, 0 + 2 + 1 + 1);
  EXPECT_EQ(loss.gradient[0], (Rgb{0, 0, 0}));
  EXPECT_EQ(loss.gradient[2], (Rgb{0, -0.5, 0})) << "it turns towards the normal, the slower the longer it is";
  EXPECT_EQ(loss.gradient[3], (Rgb{0, 0, 0}));
}

TEST(Losses, SigmoidTermIsFiniteAtEveryDistance) {
  const ScalarLoss loss = inside_loss(std::vector<double>{-1e6, -1, 0, 1, 1e6}, 1);
  EXPECT_EQ(loss.value, 2.5);
  EXPECT_EQ(loss.gradient, (std::vector<double>{0, 0, 1250, 0, 0}));
}

TEST(Losses, AlphaTermIsClampedAtBothEnds) {
  // All-black and all-foreground masks on rays that are empty or full: the entropy stays at −ln 1e-3.
  const ScalarLoss loss = alpha_loss(std::vector<double>{0, 1, 0, 1}, std::vector<double>{0, 0, 1, 1}, 1);
  EXPECT_NEAR(loss.value, -2 * std::log(1e-3) - 2 * std::log(1 - 1e-3), 1e-12);
  EXPECT_EQ(loss.gradient, std::vector<double>(4, 0.0));
  // It pulls the right way in between.
  const ScalarLoss pull = alpha_loss(std::vector<double>{0.5, 0.5}, std::vector<double>{0, 1}, 1);
  EXPECT_EQ(pull.gradient, (std::vector<double>{2, -2}));
}

}  // namespace
}  // namespace arah::reference
