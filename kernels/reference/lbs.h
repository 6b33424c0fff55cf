// Linear blend skinning, x_bar = sum_b w_b B_b x, and its derivatives, in double precision (paper, eq. of section 3.2;
// ARAH.md section 2). Lengths in metres; no root translation.
//
// bone_transforms: [joints][4][4] row-major, canonical to posed; weights: [points][joints]; points: [points][3].
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace arah::reference {

// T = sum_b w_b B_b -> [points][4][4]. These functions throw std::invalid_argument when sizes do not fit.
std::vector<double> blend_transforms(std::size_t points, std::span<const double> weights,
                                     std::span<const double> bone_transforms);

// x_bar = (T [x; 1])_xyz -> [points][3].
std::vector<double> lbs_forward(std::size_t points, std::span<const double> weights,
                                std::span<const double> bone_transforms, std::span<const double> x);

// x with T [x; 1] = [x_bar; 1] -> [points][3]; NaN where T [points][4][4] has no inverse.
std::vector<double> inverse_blend(std::size_t points, std::span<const double> transforms, std::span<const double> x_bar);

// Of weights that are given at x_bar and not at x (a backward skinning network): dL/dweights [points][joints] from d_x
// [points][3]. T x = x_bar stays, so dx = −T⁻¹ (dT x): the weights get what those of lbs_backward get at x from the
// cotangent −T⁻ᵀ d_x. 0 where T has no inverse.
std::vector<double> inverse_blend_backward(std::size_t points, std::span<const double> weights,
                                           std::span<const double> bone_transforms, std::span<const double> x,
                                           std::span<const double> d_x);

struct LbsGradients {
  std::vector<double> weights;  // [points][joints]: dL/dw_b = (B_b x) . d_x_bar
  std::vector<double> x;        // [points][3]: T^T d_x_bar, the weights held fixed
};

// d_x_bar [points][3]. Adds dL/dB to d_bone_transforms [joints][4][4] (the last rows get nothing) unless it is empty.
LbsGradients lbs_backward(std::size_t points, std::span<const double> weights, std::span<const double> bone_transforms,
                          std::span<const double> x, std::span<const double> d_x_bar,
                          std::span<double> d_bone_transforms);

}  // namespace arah::reference
