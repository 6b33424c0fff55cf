// A stack of linear layers with activations, optional weight normalisation and input concatenation, in double
// precision: the skinning, colour and mapping networks are three of its shapes (ARAH.md sections 1 to 3).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "kernels/reference/activation.h"

namespace arah::reference {

struct DenseLayer {
  std::size_t inputs = 0;  // counts the concatenated network input too
  std::size_t outputs = 0;
  Activation activation = Activation::none;
  bool concatenates_input = false;  // the layer reads [network input, previous output]
  std::vector<double> v;            // [inputs][outputs]: the weights, or their direction when g is not empty
  std::vector<double> g;            // [outputs] magnitudes of the weight normalisation, or empty (none)
  std::vector<double> b;            // [outputs]

  // The matrix that is applied: v, or g v/|v|.
  std::vector<double> weights() const;
};

struct DenseNetwork {
  std::vector<DenseLayer> layers;

  std::size_t input_size() const { return layers.front().inputs; }
  std::size_t output_size() const { return layers.back().outputs; }

  // The same shape with every number 0: where gradients are gathered.
  DenseNetwork zeros() const;
};

// What the backward pass needs of a forward pass over `points` points.
struct DenseTape {
  std::size_t points = 0;
  std::vector<std::vector<double>> inputs;           // of each layer [points][inputs]
  std::vector<std::vector<double>> pre_activations;  // of each layer [points][outputs]
  std::vector<double> output;                        // [points][output_size]
};

// x [points][input_size]. Throws std::invalid_argument when the layers do not fit each other or x.
DenseTape dense_forward(const DenseNetwork& network, std::size_t points, std::span<const double> x);

// The gradient at the input, [points][input_size], of the functional whose gradient at the output is d_output
// [points][output_size]. When `gradients` is given (shaped like the network), the parameter gradients are added to it.
std::vector<double> dense_backward(const DenseNetwork& network, const DenseTape& tape, std::span<const double> d_output,
                                   DenseNetwork* gradients);

}  // namespace arah::reference
