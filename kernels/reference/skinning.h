// The skinning network and forward skinning of canonical points, with Jacobian and backward pass, in double precision
// (ARAH.md section 2): n(x) -> weight-normalised layers with softplus -> logits, times 20 -> hierarchical softmax ->
// weights -> linear blend skinning.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "kernels/reference/cube.h"
#include "kernels/reference/dense_network.h"
#include "kernels/reference/hierarchical_softmax.h"

namespace arah::reference {

struct SkinningNetwork {
  JointTree tree;
  Cube cube;
  DenseNetwork layers;  // 3 inputs, tree.logits() outputs
  double logit_scale = 20;
};

struct SkinningOutput {
  std::vector<double> logits;   // [points][logits], before the scale
  std::vector<double> weights;  // [points][joints]
  std::vector<double> blended;  // [points][4][4]: T = sum_b w_b B_b
  std::vector<double> x_bar;    // [points][3], metres, without root translation
};

// x [points][3] canonical metres; bone_transforms [joints][4][4]. Throws std::invalid_argument when sizes do not fit.
SkinningOutput skinning_forward(const SkinningNetwork& network, std::span<const double> bone_transforms,
                                std::size_t points, std::span<const double> x);

// d x_bar_i / d x_j -> [points][3][3], metres per metre: T's own 3x3 part and the change of the weights, including the
// factor 2/(1.1 r) of n(x).
std::vector<double> skinning_jacobian(const SkinningNetwork& network, std::span<const double> bone_transforms,
                                      std::size_t points, std::span<const double> x);

// dL/d(outputs); an empty vector stands for zeros.
struct SkinningAdjoint {
  std::vector<double> x_bar;    // [points][3]
  std::vector<double> weights;  // [points][joints]: of a loss on the weights themselves
};

// Returns dL/dx [points][3]. Adds the parameter gradients to `gradients` (shaped like network.layers) unless it is
// null, and dL/dB to d_bone_transforms [joints][4][4] unless that is empty.
std::vector<double> skinning_backward(const SkinningNetwork& network, std::span<const double> bone_transforms,
                                      std::size_t points, std::span<const double> x, const SkinningAdjoint& adjoint,
                                      DenseNetwork* gradients, std::span<double> d_bone_transforms);

}  // namespace arah::reference
