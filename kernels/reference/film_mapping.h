// The mapping network from a frame's latent code to the FiLM scales and shifts of the SIREN, in double precision
// (ARAH.md section 1, "Mapping net"): leaky ReLU between the layers; the first half of the outputs are the gammas of
// the sine layers, in layer order, the second half the etas.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "kernels/reference/dense_network.h"

namespace arah::reference {

struct FilmModulation {
  std::vector<double> gamma;  // [codes][sine layers * width]
  std::vector<double> eta;    // [codes][sine layers * width]
};

struct FilmMappingTape {
  DenseTape network;
  FilmModulation modulation;
};

// latent [codes][input_size]. Throws std::invalid_argument when sizes do not fit or the network's output count is odd.
FilmMappingTape film_mapping_forward(const DenseNetwork& network, std::size_t codes, std::span<const double> latent);

// dL/dlatent [codes][input_size]; adds the parameter gradients to `gradients` unless it is null.
std::vector<double> film_mapping_backward(const DenseNetwork& network, const FilmMappingTape& tape,
                                          const FilmModulation& d_modulation, DenseNetwork* gradients);

}  // namespace arah::reference
