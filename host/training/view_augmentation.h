// View directions that the colour network learns from although no camera looked so (ARAH.md §7, augmentation): what a
// surface looks like is then less learned by heart for each view.
#pragma once

#include <array>
#include <optional>
#include <random>

namespace arah {

// With the probability a rotation for all view directions of a step, by row: R = R_x(roll) R_y(pitch) R_z(yaw), the three
// angles normally distributed with a deviation of 45° (the paper's). Samples whose surface could not be seen so keep their
// own direction (kernels/color/assemble_inputs.h).
std::optional<std::array<float, 9>> draw_view_rotation(double probability, std::mt19937_64& generator);

}  // namespace arah
