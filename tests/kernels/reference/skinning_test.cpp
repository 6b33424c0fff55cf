#include "kernels/reference/skinning.h"

#include <gtest/gtest.h>

#include <cmath>

#include "kernels/reference/lbs.h"
#include "tests/kernels/reference/finite_differences.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah::reference {
namespace {

using golden::expect_golden;

// Six joints, layers of 5 and 7; sine instead of softplus, whose curvature of 100/4 would blunt the differences.
SkinningNetwork small_network() {
  SkinningNetwork network{JointTree({-1, 0, 1, 1, 3, 1}), {{0.1, -0.2, 0.3}, -0.8, 1.1}, {}};
  const std::size_t sizes[] = {3, 5, 7, network.tree.logits()};
  for (std::size_t l = 0; l < 3; ++l) {
    const unsigned seed = static_cast<unsigned>(10 * l);
    DenseLayer layer;
    layer.inputs = sizes[l];
    layer.outputs = sizes[l + 1];
    layer.activation = l < 2 ? Activation::sine : Activation::none;
    layer.v = random_values(sizes[l] * sizes[l + 1], 1, seed + 1);
    layer.g = random_values(sizes[l + 1], l < 2 ? 1 : 0.1, seed + 2);
    layer.b = random_values(sizes[l + 1], l < 2 ? 0.5 : 0.05, seed + 3);
    network.layers.layers.push_back(std::move(layer));
  }
  return network;
}

TEST(Cube, MapsBackAndForth) {
  const Cube cube{{0.1, -0.2, 0.3}, -0.8, 1.1};
  const Vec3 x = {0.4, 0.9, -1.3};
  const Vec3 back = cube.from_cube(cube.to_cube(x));
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(back[i], x[i], 1e-14);
  // the body's bounds keep a margin of 5 % of the extent: 2 * 0.05 / 1.1 of the cube
  EXPECT_NEAR(cube.to_cube({0.1 - 0.8, -0.2 + 1.1, 0.3})[0], -1 + 0.1 / 1.1, 1e-14);
  EXPECT_NEAR(cube.to_cube({0.1 - 0.8, -0.2 + 1.1, 0.3})[1], 1 - 0.1 / 1.1, 1e-14);
}

TEST(Cube, MatchesTheGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("01_kinematics");
  const std::vector<double> center = truth.values("out.center");
  const Cube cube{{center[0], center[1], center[2]}, truth.scalar("out.cmin"), truth.scalar("out.cmax")};
  std::vector<double> n, x;
  const std::vector<double> metres = truth.values("in.x"), units = truth.values("in.xn");
  for (std::size_t p = 0; p < metres.size(); p += 3) {
    for (double value : cube.to_cube({metres[p], metres[p + 1], metres[p + 2]})) n.push_back(value);
    for (double value : cube.from_cube({units[p], units[p + 1], units[p + 2]})) x.push_back(value);
  }
  expect_golden(truth, "out.n", n);
  expect_golden(truth, "out.x_from_n", x);
}

TEST(InverseBlend, UndoesSkinningAndItsGradientMatchesDifferences) {
  const std::size_t points = 4, joints = 3;
  std::vector<double> weights = random_values(points * joints, 0.2, 1), bones = random_values(joints * 16, 0.2, 2);
  for (std::size_t b = 0; b < joints; ++b)
    for (std::size_t i = 0; i < 4; ++i) bones[16 * b + 5 * i] += 1, bones[16 * b + 12 + i] = i == 3;
  for (std::size_t p = 0; p < points; ++p) {
    double sum = 0;
    for (std::size_t b = 0; b < joints; ++b) sum += weights[p * joints + b] += 0.3;
    for (std::size_t b = 0; b < joints; ++b) weights[p * joints + b] /= sum;
  }
  const std::vector<double> x = random_values(points * 3, 1, 3), x_bar = lbs_forward(points, weights, bones, x);
  const auto found = [&] { return inverse_blend(points, blend_transforms(points, weights, bones), x_bar); };
  const std::vector<double> back = found();
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_NEAR(back[i], x[i], 1e-13);
  const std::vector<double> d_x = random_values(points * 3, 1, 4);
  const std::vector<double> d_weights = inverse_blend_backward(points, weights, bones, x, d_x);
  expect_gradient("weights of the inverse", [&] { return dot(d_x, found()); }, weights, d_weights);
  for (double value : inverse_blend(1, std::vector<double>(16, 0.0), std::vector<double>(3, 1.0))) EXPECT_TRUE(std::isnan(value));
}

TEST(Lbs, BackwardMatchesFiniteDifferences) {
  const std::size_t points = 3, joints = 5;
  std::vector<double> weights = random_values(points * joints, 1, 1), bones = random_values(joints * 16, 1, 2);
  std::vector<double> x = random_values(points * 3, 1, 3);
  const std::vector<double> d_x_bar = random_values(points * 3, 1, 4);
  const auto loss = [&] { return dot(d_x_bar, lbs_forward(points, weights, bones, x)); };
  std::vector<double> d_bones(bones.size(), 0.0);
  const LbsGradients gradients = lbs_backward(points, weights, bones, x, d_x_bar, d_bones);
  expect_gradient("lbs weights", loss, weights, gradients.weights, 1e-3);
  expect_gradient("lbs x", loss, x, gradients.x, 1e-3);
  expect_gradient("lbs bone_transforms", loss, bones, d_bones, 1e-3);
}

TEST(Skinning, BackwardMatchesFiniteDifferences) {
  SkinningNetwork network = small_network();
  const std::size_t points = 4;
  std::vector<double> x = random_values(points * 3, 1, 11), bones = random_values(6 * 16, 1, 12);
  const SkinningAdjoint adjoint{random_values(points * 3, 1, 13), random_values(points * 6, 1, 14)};
  const auto loss = [&] {
    const SkinningOutput output = skinning_forward(network, bones, points, x);
    return dot(adjoint.x_bar, output.x_bar) + dot(adjoint.weights, output.weights);
  };
  DenseNetwork gradients = network.layers.zeros();
  std::vector<double> d_bones(bones.size(), 0.0);
  const std::vector<double> d_x = skinning_backward(network, bones, points, x, adjoint, &gradients, d_bones);
  expect_gradient("skinning x", loss, x, d_x);
  expect_gradient("skinning bone_transforms", loss, bones, d_bones);
  for (std::size_t l = 0; l < gradients.layers.size(); ++l) {
    const std::string layer = " of layer " + std::to_string(l);
    expect_gradient("skinning v" + layer, loss, network.layers.layers[l].v, gradients.layers[l].v);
    expect_gradient("skinning g" + layer, loss, network.layers.layers[l].g, gradients.layers[l].g);
    expect_gradient("skinning b" + layer, loss, network.layers.layers[l].b, gradients.layers[l].b);
  }
}

TEST(Skinning, JacobianMatchesFiniteDifferences) {
  const SkinningNetwork network = small_network();
  std::vector<double> x = random_values(3, 1, 21);
  const std::vector<double> bones = random_values(6 * 16, 1, 22);
  const std::vector<double> jacobian = skinning_jacobian(network, bones, 1, x);
  for (std::size_t i = 0; i < 3; ++i) {
    expect_gradient(
        "skinning jacobian row " + std::to_string(i), [&] { return skinning_forward(network, bones, 1, x).x_bar[i]; },
        x, std::span(jacobian).subspan(i * 3, 3));
  }
}

TEST(Skinning, MovesAPointRigidlyWhenAllBonesAgree) {
  const SkinningNetwork network = small_network();
  const std::vector<double> bone = {0, -1, 0, 0.5, 1, 0, 0, -0.25, 0, 0, 1, 2, 0, 0, 0, 1};
  std::vector<double> bones;
  for (int b = 0; b < 6; ++b) bones.insert(bones.end(), bone.begin(), bone.end());
  const std::vector<double> x = {0.3, -0.6, 0.9};
  const std::vector<double> x_bar = skinning_forward(network, bones, 1, x).x_bar;
  EXPECT_NEAR(x_bar[0], 0.6 + 0.5, 1e-14);
  EXPECT_NEAR(x_bar[1], 0.3 - 0.25, 1e-14);
  EXPECT_NEAR(x_bar[2], 0.9 + 2, 1e-14);
  const std::vector<double> jacobian = skinning_jacobian(network, bones, 1, x);
  for (std::size_t k = 0; k < 9; ++k) EXPECT_NEAR(jacobian[k], bone[k / 3 * 4 + k % 3], 1e-13) << k;
}

TEST(Skinning, MatchesTheGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("03_lbs_net");
  const SkinningNetwork network = golden_skinning(truth, truth);
  const std::size_t points = extent(truth, "in.x", 0);
  const std::vector<double> x = truth.values("in.x"), bones = truth.values("in.B");
  const SkinningOutput output = skinning_forward(network, bones, points, x);
  expect_golden(truth, "out.logits", output.logits);
  expect_golden(truth, "out.w", output.weights);
  expect_golden(truth, "out.T", output.blended);
  expect_golden(truth, "out.x_bar", output.x_bar);
  expect_golden(truth, "out.jac", skinning_jacobian(network, bones, points, x));

  const SkinningAdjoint adjoint{truth.values("in.G"), {}};
  expect_golden(truth, "out.L", dot(adjoint.x_bar, output.x_bar));
  DenseNetwork gradients = network.layers.zeros();
  std::vector<double> d_bones(bones.size(), 0.0);
  expect_golden(truth, "grad.x", skinning_backward(network, bones, points, x, adjoint, &gradients, d_bones));
  expect_golden(truth, "grad.B", d_bones);
  expect_golden_dense(truth, "lbs", gradients);
}

}  // namespace
}  // namespace arah::reference
