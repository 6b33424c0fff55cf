// The networks of the golden cases, from their [out, in] parameter tensors to the [inputs][outputs] of the references,
// and their gradients back.
#pragma once

#include <string>
#include <vector>

#include "kernels/reference/dense_network.h"
#include "kernels/reference/linear.h"
#include "kernels/reference/siren.h"
#include "kernels/reference/skinning.h"
#include "tests/golden.h"

namespace arah::reference {

inline std::size_t extent(const golden::Case& truth, const std::string& tensor, std::size_t axis) {
  return static_cast<std::size_t>(truth.extent(tensor, axis));
}

// A matrix stored [out, in], as [inputs][outputs].
inline std::vector<double> golden_matrix(const golden::Case& truth, const std::string& tensor) {
  return transposed(truth.values(tensor), extent(truth, tensor, 0), extent(truth, tensor, 1));
}

// "param.sdf.<i>.{W,b,gamma,eta}".
inline Siren golden_siren(const golden::Case& truth) {
  Siren siren;
  for (int i = 0; truth.has("param.sdf." + std::to_string(i) + ".W"); ++i) {
    const std::string name = "param.sdf." + std::to_string(i) + ".";
    SirenLayer layer{extent(truth, name + "W", 1),
                     extent(truth, name + "W", 0),
                     golden_matrix(truth, name + "W"),
                     truth.values(name + "b"),
                     {},
                     {}};
    if (truth.has(name + "gamma")) {
      layer.gamma = truth.values(name + "gamma");
      layer.eta = truth.values(name + "eta");
    }
    siren.layers.push_back(std::move(layer));
  }
  return siren;
}

// "param.<prefix>.<i>.{v,g,b}" (weight normalisation) or "{W,b}" (none); every layer but the last gets `hidden`.
inline DenseNetwork golden_dense(const golden::Case& truth, const std::string& prefix, Activation hidden,
                                 Activation last) {
  DenseNetwork network;
  const auto name = [&](int i) { return "param." + prefix + "." + std::to_string(i) + "."; };
  for (int i = 0; truth.has(name(i) + "b"); ++i) {
    const bool normalised = truth.has(name(i) + "v");
    const std::string matrix = name(i) + (normalised ? "v" : "W");
    DenseLayer layer;
    layer.inputs = extent(truth, matrix, 1);
    layer.outputs = extent(truth, matrix, 0);
    layer.activation = truth.has(name(i + 1) + "b") ? hidden : last;
    layer.v = golden_matrix(truth, matrix);
    if (normalised) layer.g = truth.values(name(i) + "g");
    layer.b = truth.values(name(i) + "b");
    network.layers.push_back(std::move(layer));
  }
  return network;
}

// Compares gradients, shaped like golden_dense's network, with "grad.<prefix>.<i>.*".
inline void expect_golden_dense(const golden::Case& truth, const std::string& prefix, const DenseNetwork& gradients) {
  for (std::size_t i = 0; i < gradients.layers.size(); ++i) {
    const DenseLayer& layer = gradients.layers[i];
    const std::string name = "grad." + prefix + "." + std::to_string(i) + ".";
    golden::expect_golden(truth, name + (layer.g.empty() ? "W" : "v"),
                          transposed(layer.v, layer.inputs, layer.outputs));
    if (!layer.g.empty()) golden::expect_golden(truth, name + "g", layer.g);
    golden::expect_golden(truth, name + "b", layer.b);
  }
}

inline std::vector<int> smpl_parents() {
  return {-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21};
}

// "param.lbs.*" with the cube of "in.center", "in.cmin", "in.cmax".
inline SkinningNetwork golden_skinning(const golden::Case& parameters, const golden::Case& inputs) {
  const std::vector<double> center = inputs.values("in.center");
  return {JointTree(smpl_parents()),
          {{center.at(0), center.at(1), center.at(2)}, inputs.scalar("in.cmin"), inputs.scalar("in.cmax")},
          golden_dense(parameters, "lbs", Activation::softplus, Activation::none)};
}

}  // namespace arah::reference
