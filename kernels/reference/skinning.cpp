#include "kernels/reference/skinning.h"

#include <utility>

#include "kernels/reference/lbs.h"
#include "kernels/reference/sizes.h"

namespace arah::reference {
namespace {

struct SkinningTape {
  DenseTape network;
  std::vector<double> scaled_logits;
  std::vector<double> weights;
};

SkinningTape evaluate(const SkinningNetwork& network, std::span<const double> bone_transforms, std::size_t points,
                      std::span<const double> x) {
  check_size("skinning: x", x.size(), points * 3);
  check_size("skinning: bone_transforms", bone_transforms.size(), network.tree.joints() * 16);
  check_size("skinning: outputs of the network", network.layers.output_size(), network.tree.logits());
  std::vector<double> cube(x.size());
  for (std::size_t p = 0; p < points; ++p) {
    const Vec3 n = network.cube.to_cube({x[p * 3], x[p * 3 + 1], x[p * 3 + 2]});
    for (std::size_t i = 0; i < 3; ++i) cube[p * 3 + i] = n[i];
  }
  SkinningTape tape;
  tape.network = dense_forward(network.layers, points, cube);
  tape.scaled_logits = tape.network.output;
  for (double& logit : tape.scaled_logits) logit *= network.logit_scale;
  tape.weights = hierarchical_softmax_forward(network.tree, points, tape.scaled_logits);
  return tape;
}

std::vector<double> backward(const SkinningNetwork& network, const SkinningTape& tape,
                             std::span<const double> bone_transforms, std::size_t points, std::span<const double> x,
                             const SkinningAdjoint& adjoint, DenseNetwork* gradients,
                             std::span<double> d_bone_transforms) {
  LbsGradients lbs{std::vector<double>(tape.weights.size(), 0.0), std::vector<double>(x.size(), 0.0)};
  if (!adjoint.x_bar.empty()) {
    lbs = lbs_backward(points, tape.weights, bone_transforms, x, adjoint.x_bar, d_bone_transforms);
  }
  if (!adjoint.weights.empty()) {
    check_size("skinning backward: weights", adjoint.weights.size(), lbs.weights.size());
    for (std::size_t i = 0; i < lbs.weights.size(); ++i) lbs.weights[i] += adjoint.weights[i];
  }
  std::vector<double> d_logits = hierarchical_softmax_backward(network.tree, points, tape.scaled_logits, lbs.weights);
  for (double& d : d_logits) d *= network.logit_scale;
  const std::vector<double> d_cube = dense_backward(network.layers, tape.network, d_logits, gradients);
  for (std::size_t i = 0; i < d_cube.size(); ++i) lbs.x[i] += network.cube.scale() * d_cube[i];
  return std::move(lbs.x);
}

}  // namespace

SkinningOutput skinning_forward(const SkinningNetwork& network, std::span<const double> bone_transforms,
                                std::size_t points, std::span<const double> x) {
  SkinningTape tape = evaluate(network, bone_transforms, points, x);
  SkinningOutput output;
  output.blended = blend_transforms(points, tape.weights, bone_transforms);
  output.x_bar = lbs_forward(points, tape.weights, bone_transforms, x);
  output.logits = std::move(tape.network.output);
  output.weights = std::move(tape.weights);
  return output;
}

std::vector<double> skinning_jacobian(const SkinningNetwork& network, std::span<const double> bone_transforms,
                                      std::size_t points, std::span<const double> x) {
  const SkinningTape tape = evaluate(network, bone_transforms, points, x);
  std::vector<double> jacobian(points * 9);
  for (std::size_t i = 0; i < 3; ++i) {  // row i is the gradient of x_bar_i
    SkinningAdjoint adjoint{std::vector<double>(points * 3, 0.0), {}};
    for (std::size_t p = 0; p < points; ++p) adjoint.x_bar[p * 3 + i] = 1;
    const std::vector<double> d_x = backward(network, tape, bone_transforms, points, x, adjoint, nullptr, {});
    for (std::size_t p = 0; p < points; ++p) {
      for (std::size_t j = 0; j < 3; ++j) jacobian[p * 9 + i * 3 + j] = d_x[p * 3 + j];
    }
  }
  return jacobian;
}

std::vector<double> skinning_backward(const SkinningNetwork& network, std::span<const double> bone_transforms,
                                      std::size_t points, std::span<const double> x, const SkinningAdjoint& adjoint,
                                      DenseNetwork* gradients, std::span<double> d_bone_transforms) {
  const SkinningTape tape = evaluate(network, bone_transforms, points, x);
  return backward(network, tape, bone_transforms, points, x, adjoint, gradients, d_bone_transforms);
}

}  // namespace arah::reference
