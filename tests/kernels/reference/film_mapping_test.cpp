#include "kernels/reference/film_mapping.h"

#include <gtest/gtest.h>

#include "tests/kernels/reference/finite_differences.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah::reference {
namespace {

using golden::expect_golden;

DenseNetwork small_network() {
  DenseNetwork network;
  const std::size_t sizes[] = {5, 7, 3, 8};
  for (std::size_t l = 0; l < 3; ++l) {
    const unsigned seed = static_cast<unsigned>(10 * l);
    network.layers.push_back({sizes[l],
                              sizes[l + 1],
                              l < 2 ? Activation::leaky_relu : Activation::none,
                              false,
                              random_values(sizes[l] * sizes[l + 1], 1, seed + 1),
                              {},
                              random_values(sizes[l + 1], 1, seed + 2)});
  }
  return network;
}

TEST(FilmMapping, BackwardMatchesFiniteDifferences) {
  DenseNetwork network = small_network();
  const std::size_t codes = 3;
  std::vector<double> latent = random_values(codes * 5, 1, 41);
  const FilmModulation weights{random_values(codes * 4, 1, 42), random_values(codes * 4, 1, 43)};
  const auto loss = [&] {
    const FilmModulation modulation = film_mapping_forward(network, codes, latent).modulation;
    return dot(weights.gamma, modulation.gamma) + dot(weights.eta, modulation.eta);
  };
  DenseNetwork gradients = network.zeros();
  const std::vector<double> d_latent =
      film_mapping_backward(network, film_mapping_forward(network, codes, latent), weights, &gradients);
  expect_gradient("mapping latent", loss, latent, d_latent, 1e-5);
  for (std::size_t l = 0; l < 3; ++l) {
    expect_gradient("mapping w", loss, network.layers[l].v, gradients.layers[l].v, 1e-5);
    expect_gradient("mapping b", loss, network.layers[l].b, gradients.layers[l].b, 1e-5);
  }
}

TEST(FilmMapping, RefusesAnOddOutput) {
  DenseNetwork network = small_network();
  network.layers.pop_back();
  EXPECT_THROW(film_mapping_forward(network, 1, std::vector<double>(5)), std::invalid_argument);
}

TEST(FilmMapping, MatchesTheGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("05_mapping");
  const DenseNetwork network = golden_dense(truth, "map", Activation::leaky_relu, Activation::none);
  const std::size_t codes = extent(truth, "in.Z", 0);
  const FilmMappingTape tape = film_mapping_forward(network, codes, truth.values("in.Z"));
  expect_golden(truth, "out.gamma", tape.modulation.gamma);
  expect_golden(truth, "out.eta", tape.modulation.eta);
  const std::vector<double> weights = truth.values("in.G");  // [codes][gammas, etas]
  expect_golden(truth, "out.L", dot(weights, tape.network.output));
  const std::size_t half = weights.size() / codes / 2;
  FilmModulation d;
  for (std::size_t i = 0; i < weights.size(); ++i) (i / half % 2 == 0 ? d.gamma : d.eta).push_back(weights[i]);
  DenseNetwork gradients = network.zeros();
  expect_golden(truth, "grad.Z", film_mapping_backward(network, tape, d, &gradients));
  expect_golden_dense(truth, "map", gradients);
}

}  // namespace
}  // namespace arah::reference
