#include "kernels/reference/film_mapping.h"

#include "kernels/reference/sizes.h"

namespace arah::reference {

FilmMappingTape film_mapping_forward(const DenseNetwork& network, std::size_t codes, std::span<const double> latent) {
  const std::size_t half = network.output_size() / 2;
  check_size("film mapping: outputs", network.output_size(), 2 * half);
  FilmMappingTape tape{dense_forward(network, codes, latent), {}};
  for (std::size_t c = 0; c < codes; ++c) {
    const auto row = std::span(tape.network.output).subspan(c * 2 * half, 2 * half);
    tape.modulation.gamma.insert(tape.modulation.gamma.end(), row.begin(),
                                 row.begin() + static_cast<std::ptrdiff_t>(half));
    tape.modulation.eta.insert(tape.modulation.eta.end(), row.begin() + static_cast<std::ptrdiff_t>(half), row.end());
  }
  return tape;
}

std::vector<double> film_mapping_backward(const DenseNetwork& network, const FilmMappingTape& tape,
                                          const FilmModulation& d_modulation, DenseNetwork* gradients) {
  const std::size_t half = network.output_size() / 2;
  const std::size_t codes = tape.network.points;
  check_size("film mapping backward: gamma", d_modulation.gamma.size(), codes * half);
  check_size("film mapping backward: eta", d_modulation.eta.size(), codes * half);
  std::vector<double> d_output;
  for (std::size_t c = 0; c < codes; ++c) {
    const auto gamma = std::span(d_modulation.gamma).subspan(c * half, half);
    const auto eta = std::span(d_modulation.eta).subspan(c * half, half);
    d_output.insert(d_output.end(), gamma.begin(), gamma.end());
    d_output.insert(d_output.end(), eta.begin(), eta.end());
  }
  return dense_backward(network, tape.network, d_output, gradients);
}

}  // namespace arah::reference
