#include "kernels/reference/siren.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/kernels/reference/finite_differences.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah::reference {
namespace {

using golden::expect_golden;

// Odd sizes: 3 inputs, sine layers of 5, 7 and 6.
Siren small_siren() {
  Siren siren;
  const std::size_t sizes[] = {3, 5, 7, 6, 1};
  for (std::size_t l = 0; l < 4; ++l) {
    const unsigned seed = static_cast<unsigned>(10 * l);
    SirenLayer layer{sizes[l],
                     sizes[l + 1],
                     random_values(sizes[l] * sizes[l + 1], 0.1, seed + 1),
                     random_values(sizes[l + 1], 0.3, seed + 2),
                     {},
                     {}};
    if (l < 3) {
      layer.gamma = random_values(sizes[l + 1], 1, seed + 3);
      layer.eta = random_values(sizes[l + 1], 0.1, seed + 4);
    }
    siren.layers.push_back(std::move(layer));
  }
  return siren;
}

TEST(Siren, SpatialGradientMatchesFiniteDifferences) {
  const Siren siren = small_siren();
  std::vector<double> x = random_values(4 * 3, 1, 99);
  const std::vector<double> weights = random_values(4, 1, 98);
  std::vector<double> weighted = siren_forward(siren, 4, x).gradient;
  for (std::size_t i = 0; i < weighted.size(); ++i) weighted[i] *= weights[i / 3];
  expect_gradient(
      "siren df/dx", [&] { return dot(weights, siren_forward(siren, 4, x).sdf); }, x, weighted);
}

TEST(Siren, BackwardMatchesFiniteDifferences) {
  Siren siren = small_siren();
  const std::size_t points = 5;
  std::vector<double> x = random_values(points * 3, 1, 97);
  const SirenAdjoint full{random_values(points, 1, 1), random_values(points * 6, 1, 2),
                          random_values(points * 3, 0.3, 3)};
  const SirenAdjoint cases[] = {full, {full.sdf, {}, {}}, {{}, {}, full.gradient}};
  for (const SirenAdjoint& adjoint : cases) {
    const auto loss = [&] {
      const SirenOutput output = siren_forward(siren, points, x);
      double sum = 0;
      if (!adjoint.sdf.empty()) sum += dot(adjoint.sdf, output.sdf);
      if (!adjoint.feature.empty()) sum += dot(adjoint.feature, output.feature);
      if (!adjoint.gradient.empty()) sum += dot(adjoint.gradient, output.gradient);
      return sum;
    };
    Siren gradients = siren.zeros();
    const std::vector<double> d_x = siren_backward(siren, points, x, adjoint, gradients);
    expect_gradient("siren x", loss, x, d_x);
    for (std::size_t l = 0; l < siren.layers.size(); ++l) {
      const std::string layer = " of layer " + std::to_string(l);
      expect_gradient("siren w" + layer, loss, siren.layers[l].w, gradients.layers[l].w);
      const bool last = l + 1 == siren.layers.size();
      if (!last || !adjoint.sdf.empty()) {
        expect_gradient("siren b" + layer, loss, siren.layers[l].b, gradients.layers[l].b);
      }
      if (last) continue;
      expect_gradient("siren gamma" + layer, loss, siren.layers[l].gamma, gradients.layers[l].gamma);
      expect_gradient("siren eta" + layer, loss, siren.layers[l].eta, gradients.layers[l].eta);
    }
  }
}

TEST(Siren, RefusesLayersThatDoNotFit) {
  Siren siren = small_siren();
  siren.layers[1].gamma.pop_back();
  EXPECT_THROW(siren_forward(siren, 1, std::vector<double>(3)), std::invalid_argument);
  EXPECT_THROW(siren_forward(small_siren(), 2, std::vector<double>(3)), std::invalid_argument);
}

// Gradients against "<kind>.sdf.*" where stored, and their 2-norms against "<kind>_norm.sdf.*", which cover every
// tensor.
void expect_golden_siren(const golden::Case& truth, const std::string& kind, const Siren& gradients,
                         const std::vector<double>& d_x) {
  const auto compare = [&](const std::string& tensor, const std::vector<double>& values) {
    if (truth.has(kind + "." + tensor)) expect_golden(truth, kind + "." + tensor, values);
    expect_golden(truth, kind + "_norm." + tensor, std::sqrt(dot(values, values)));
  };
  compare("x", d_x);
  for (std::size_t i = 0; i < gradients.layers.size(); ++i) {
    const SirenLayer& layer = gradients.layers[i];
    const std::string name = "sdf." + std::to_string(i) + ".";
    compare(name + "W", transposed(layer.w, layer.inputs, layer.outputs));
    compare(name + "b", layer.b);
    if (layer.gamma.empty()) continue;
    compare(name + "gamma", layer.gamma);
    compare(name + "eta", layer.eta);
  }
}

void expect_golden_case(const golden::Case& truth, const golden::Case& parameters) {
  const Siren siren = golden_siren(parameters);
  const std::size_t points = extent(truth, "in.x", 0);
  const std::vector<double> x = truth.values("in.x");
  const SirenOutput output = siren_forward(siren, points, x);
  expect_golden(truth, "out.f", output.sdf);
  expect_golden(truth, "out.z", output.feature);
  expect_golden(truth, "out.grad", output.gradient);

  const SirenAdjoint adjoint{truth.values("in.Ga"), truth.values("in.Gz"), truth.values("in.Gn")};
  expect_golden(
      truth, "out.L",
      dot(adjoint.sdf, output.sdf) + dot(adjoint.feature, output.feature) + dot(adjoint.gradient, output.gradient));
  Siren gradients = siren.zeros();
  std::vector<double> d_x = siren_backward(siren, points, x, adjoint, gradients);
  expect_golden_siren(truth, "grad", gradients, d_x);

  // E = sum abs(|n| - 1), so dE/dn = sign(|n| - 1) n/|n|
  SirenAdjoint eikonal{{}, {}, output.gradient};
  double sum = 0;
  for (std::size_t p = 0; p < points; ++p) {
    double* n = eikonal.gradient.data() + p * 3;
    const double length = std::hypot(n[0], n[1], n[2]);
    sum += std::abs(length - 1);
    for (int i = 0; i < 3; ++i) n[i] *= (length > 1 ? 1 : -1) / length;
  }
  expect_golden(truth, "out.E", sum);
  gradients = siren.zeros();
  d_x = siren_backward(siren, points, x, eikonal, gradients);
  expect_golden_siren(truth, "gradE", gradients, d_x);
}

TEST(Siren, MatchesTheSmallGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("04_siren_small");
  expect_golden_case(truth, truth);
}

TEST(Siren, MatchesTheFullGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  expect_golden_case(golden::Case("04_siren_full"), golden::Case("04_siren_full_params"));
}

}  // namespace
}  // namespace arah::reference
