// The way back through posed normals that are not of unit length (kernels/color/posed_normals.h).
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// d_gradient = T₃ₓ₃ᵀ d_normal, with T held fixed: the cotangent that a second-order backward pass of the sdf reads.
struct PosedNormalsBackwardArgs {
  uint32_t rows = 0;
  BufferSlice d_normals;   // vec4 by row: dL/dnormal, w unused
  BufferSlice transforms;  // three vec4 by row, as in the forward run, or empty
  Matrix d_gradients;      // out (=), by row [8]: dL/d(∂f/∂n) in channels 0..2, zeros in 3..7; 0 where d_normal is 0
};
// Throws std::invalid_argument where d_gradients has no room for the eight channels.
void record_posed_normals_backward(Commands& commands, const PosedNormalsBackwardArgs& args);

}  // namespace arah
