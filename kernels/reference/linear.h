// The batched linear layer and its two transposes, in double precision: the truth of the kernels in linear/.
//
// Layouts, everywhere in this folder: activations [points][channels] and matrices [inputs][outputs], row-major, without
// padding. Parameter gradients are added to, activation gradients are returned.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "kernels/reference/activation.h"

namespace arah::reference {

struct LinearShape {
  std::size_t points = 0;
  std::size_t inputs = 0;
  std::size_t outputs = 0;
};

// X W + b -> [points][outputs], before the activation. x [points][inputs], w [inputs][outputs], b [outputs] or empty
// (no bias). This and the functions below throw std::invalid_argument when a size does not fit the shape.
std::vector<double> linear_pre_activation(const LinearShape& shape, std::span<const double> x,
                                          std::span<const double> w, std::span<const double> b);

// act(X W + b) -> [points][outputs].
std::vector<double> linear_forward(const LinearShape& shape, std::span<const double> x, std::span<const double> w,
                                   std::span<const double> b, Activation activation);

// dX = dA W^T -> [points][inputs]; d_a [points][outputs] is the gradient at the pre-activations.
std::vector<double> linear_input_gradient(const LinearShape& shape, std::span<const double> d_a,
                                          std::span<const double> w);

// dW += X^T dA [inputs][outputs] and db += the column sums of dA [outputs]; d_b may be empty (no bias).
void linear_weight_gradient(const LinearShape& shape, std::span<const double> x, std::span<const double> d_a,
                            std::span<double> d_w, std::span<double> d_b);

// [rows][columns] -> [columns][rows].
std::vector<double> transposed(std::span<const double> matrix, std::size_t rows, std::size_t columns);

// Weight normalisation: the weights of output o are g[o] v[:, o] / |v[:, o]|. v [inputs][outputs], g [outputs] ->
// W [inputs][outputs]. An output whose v is 0 has weights 0 and hands no gradient on.
std::vector<double> weight_norm_forward(std::size_t inputs, std::size_t outputs, std::span<const double> v,
                                        std::span<const double> g);

// With u = v/|v| of an output: dg += dW . u,  dv += (g/|v|) (dW - (dW . u) u).
void weight_norm_backward(std::size_t inputs, std::size_t outputs, std::span<const double> v, std::span<const double> g,
                          std::span<const double> d_w, std::span<double> d_v, std::span<double> d_g);

}  // namespace arah::reference
