// The SIREN signed-distance network with FiLM modulation, its gradient and its second-order backward pass, in double
// precision (ARAH.md section 1, "SIREN"; paper, appendix "Canonical SDF Network").
//
//   h_0 = x,   a_i = W_i h_i + b_i,   h_{i+1} = sin(omega (gamma_i a_i + eta_i)),   f = W_L h_L + b_L,   z = h_L
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace arah::reference {

struct SirenLayer {
  std::size_t inputs = 0;
  std::size_t outputs = 0;
  std::vector<double> w;      // [inputs][outputs]
  std::vector<double> b;      // [outputs]
  std::vector<double> gamma;  // [outputs]; empty on the last layer, which is linear
  std::vector<double> eta;    // [outputs]; empty on the last layer
};

struct Siren {
  std::vector<SirenLayer> layers;  // at least one sine layer, then the linear layer with one output
  double omega = 30;

  std::size_t input_size() const { return layers.front().inputs; }   // 3: cube coordinates
  std::size_t feature_size() const { return layers.back().inputs; }  // of z
  Siren zeros() const;                                               // same shape, every parameter 0
};

struct SirenOutput {
  std::vector<double> sdf;       // [points], in units of the input
  std::vector<double> feature;   // [points][feature_size]
  std::vector<double> gradient;  // [points][input_size]: df/dx, not of unit length
};

// x [points][input_size]. Throws std::invalid_argument when sizes do not fit.
SirenOutput siren_forward(const Siren& siren, std::size_t points, std::span<const double> x);

// dL/d(outputs) of a functional of sdf, feature and gradient. An empty vector stands for zeros.
struct SirenAdjoint {
  std::vector<double> sdf;       // [points]
  std::vector<double> feature;   // [points][feature_size]
  std::vector<double> gradient;  // [points][input_size]: makes the pass second-order
};

// Adds dL/d(W, b, gamma, eta) to `gradients` (shaped like the network) and returns dL/dx [points][input_size].
std::vector<double> siren_backward(const Siren& siren, std::size_t points, std::span<const double> x,
                                   const SirenAdjoint& adjoint, Siren& gradients);

}  // namespace arah::reference
