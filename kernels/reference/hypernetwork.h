// What makes the SIREN's parameters of a pose, in double precision (ARAH.md section 1, "Hypernetwork").
//   code → (linear, layer norm, ReLU) … → h,   then φ = φ₀ + A(h):
//   dense      A = W h, one row of W a number of φ
//   low rank   for a matrix of φ: A = Σ_r h_r u_r v_rᵀ, for a bias: A = C h
// φ₀ is the SIREN that the pose changes: it takes the place of the last linear layer's bias too.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace arah::reference {

// Added to the variance, as torch's LayerNorm does.
inline constexpr double kLayerNormEpsilon = 1e-5;

struct HyperLayer {
  std::size_t inputs = 0, outputs = 0;
  std::vector<double> w, b;          // [outputs][inputs], [outputs]
  std::vector<double> scale, shift;  // [outputs], of the layer norm
};

struct HyperTrunk {
  std::vector<HyperLayer> layers;
  HyperTrunk zeros() const;  // same shape, every parameter 0
};

struct HyperTape {
  struct Layer {
    std::vector<double> input;       // [inputs]
    std::vector<double> normalised;  // [outputs]: (a − mean a) / √(variance + ε), the variance a mean over outputs
    double inverse_deviation = 0;
    std::vector<double> output;      // [outputs], after scale, shift and ReLU
  };
  std::vector<Layer> layers;
  const std::vector<double>& h() const { return layers.back().output; }
};

// Throws std::invalid_argument when sizes do not fit, as all here.
HyperTape hyper_trunk_forward(const HyperTrunk& trunk, std::span<const double> code);
// dL/dcode; adds the parameter gradients to `gradients` unless it is null.
std::vector<double> hyper_trunk_backward(const HyperTrunk& trunk, const HyperTape& tape, std::span<const double> d_h,
                                         HyperTrunk* gradients);

// W h with W [numbers][h].
std::vector<double> dense_change(std::span<const double> w, std::span<const double> h);
// dL/dh; adds dL/dW = dL/dφ ⊗ h to d_w unless it is empty.
std::vector<double> dense_change_backward(std::span<const double> w, std::span<const double> h,
                                          std::span<const double> d_phi, std::span<double> d_w);

struct LowRank {
  std::size_t outputs = 0, inputs = 0, rank = 0;
  std::vector<double> u;  // [outputs][rank]
  std::vector<double> v;  // [rank][inputs]
  std::vector<double> c;  // [outputs][rank], for the bias
  LowRank zeros() const;
};

struct LayerChange {
  std::vector<double> w;  // [outputs][inputs]
  std::vector<double> b;  // [outputs]
};

LayerChange low_rank_change(const LowRank& low_rank, std::span<const double> h);
// dL/dh; adds the parameter gradients to `gradients` unless it is null.
std::vector<double> low_rank_backward(const LowRank& low_rank, std::span<const double> h, const LayerChange& d_phi,
                                      LowRank* gradients);

}  // namespace arah::reference
