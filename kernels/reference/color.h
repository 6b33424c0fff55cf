// The colour network with its inputs, forward and backward, in double precision (ARAH.md section 3).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "kernels/reference/dense_network.h"

namespace arah::reference {

// (v, sin v, cos v, sin 2v, cos 2v, sin 4v, cos 4v, ...), each 3 wide, no pi: 3 (1 + 2 octaves) numbers a point.
// view [points][3].
std::vector<double> view_encoding_forward(std::size_t points, std::span<const double> view, std::size_t octaves);

// dL/dview [points][3] from d_encoding [points][3 (1 + 2 octaves)].
std::vector<double> view_encoding_backward(std::size_t points, std::span<const double> view, std::size_t octaves,
                                           std::span<const double> d_encoding);

inline constexpr std::size_t kViewOctaves = 4;

inline constexpr double kLeastBlendDeterminant = 1e-3;  // of a blended transform that tells a direction

// The directions that the colour network takes at points, [points][3].
// view [points][3]: v, towards the camera, world axes. transforms [points][9]: T by row, then v becomes T⁻¹ v where
// |det T| > kLeastBlendDeterminant; empty: v stays. rotation: rows of R, or empty; then R v takes the place of v at points whose normal
// [points][3] it lies less than 90° from, both in the axes of the result. Throws std::invalid_argument where sizes differ.
std::vector<double> color_view(std::size_t points, std::span<const double> view, std::span<const double> transforms,
                               std::span<const double> rotation, std::span<const double> normal);

// What the colour at a point may depend on, in the order of the network's input; an empty vector leaves a part out.
// As a result of color_backward: the gradients of the same shapes.
struct ColorInputs {
  std::vector<double> x;        // [points][3] cube coordinates, not encoded
  std::vector<double> view;     // [points][3] towards the camera, encoded with kViewOctaves
  std::vector<double> normal;   // [points][3] as it is, not of unit length
  std::vector<double> feature;  // [points][any] of the SDF network
  std::vector<double> latent;   // [points][any]: the code of the point's frame
  std::vector<double> grid;     // [points][any] of a feature grid
};

// The network's input rows, [points][channels]. Throws std::invalid_argument when a part is no whole number of rows.
std::vector<double> color_input(std::size_t points, const ColorInputs& inputs);

// rgb in [0, 1] is tape.output [points][3].
DenseTape color_forward(const DenseNetwork& network, std::size_t points, const ColorInputs& inputs);

// The gradients at the inputs from d_rgb [points][3]; adds the parameters' to `gradients` unless it is null.
ColorInputs color_backward(const DenseNetwork& network, const DenseTape& tape, const ColorInputs& inputs,
                           std::span<const double> d_rgb, DenseNetwork* gradients);

}  // namespace arah::reference
