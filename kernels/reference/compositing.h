// Alpha compositing along one ray, and its gradients (ARAH.md section 6, golden 08):
//   α_i = 1 − exp(−σ_i δ_i),   w_i = α_i Π_{j<i} (1 − α_j + 1e-7),   colour C = Σ w_i c_i on black.
// Masked samples (those whose canonical point was not found) are skipped: they neither absorb nor count in the product.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/reference/density.h"

namespace arah::reference {

inline constexpr double kTransmittanceFloor = 1e-7;  // keeps the product's gradient alive behind an opaque sample
inline constexpr double kLastDelta = 1.0 / 64;       // metres

// δ of each unmasked sample: distance to the next unmasked one, `last` for the last of them; 0 for masked samples.
// depths: [samples], ascending; mask: [samples], 0 = skip.
std::vector<double> depth_differences(std::span<const double> depths, std::span<const std::uint8_t> mask,
                                      double last = kLastDelta);

// One ray's samples, in order. All spans have the same length, 0 included.
struct CompositingInput {
  std::span<const double> sdf;     // metres
  std::span<const double> deltas;  // metres, >= 0: depth_differences, or a stratum's share of the shell
  std::span<const double> depths;  // metres
  std::span<const std::array<double, 3>> rgb;
  std::span<const std::uint8_t> mask;  // 0 = skip
  double b = 0;                        // metres, after clipping (kernels/reference/density.h)
  DensityKind density = DensityKind::laplace;
};

// alpha and weights are 0 for masked samples. A ray without samples is black: all zero.
struct Composite {
  std::vector<double> density, alpha, weights;
  std::vector<double> transmittance;  // Π_{j<i} (1 − α_j + 1e-7), before each sample
  std::array<double, 3> colour{};
  double weights_sum = 0;  // Σ w_i clipped to [0, 1]
  double depth = 0;        // Σ w_i z_i, metres; not divided by weights_sum
};

Composite composite(const CompositingInput& input);

// Successive samples that share one colour.
struct SampleGroup {
  std::size_t first = 0;          // sample
  double weight = 0;              // Σ w
  std::array<double, 3> point{};  // Σ w x / Σ w
};

// One ray's samples whose weight exceeds least_weight, in order: Σ w is cut into `groups` equal parts, and a sample belongs to
// the part that the middle of its own weight lies in; a point farther than `near` from the group's first one begins another
// group all the same. weights and points have the same length; groups >= 1.
std::vector<SampleGroup> group_samples(std::span<const double> weights, std::span<const std::array<double, 3>> points, std::size_t groups, double least_weight, double near);

struct CompositingGradient {
  std::vector<double> sdf;                 // 0 for masked samples
  std::vector<std::array<double, 3>> rgb;  // likewise
  double b = 0;
};

// Gradients of a loss with dL/dcolour and dL/dweights_sum; the latter passes the clip where 0 <= Σ w_i <= 1.
// Depths and δ are constants. Without division by 1 − α, so that opaque rays have finite gradients:
//   A_i = (g_i α_i) + (1 − α_i + 1e-7) A_{i+1},   dL/dα_i = T_i (g_i − A_{i+1}),   g_i = dL/dw_i.
CompositingGradient composite_backward(const CompositingInput& input, const Composite& forward,
                                       const std::array<double, 3>& colour_gradient, double weights_sum_gradient);

}  // namespace arah::reference
