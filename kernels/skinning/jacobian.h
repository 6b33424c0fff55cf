// The Jacobian of forward skinning from its two parts (ARAH.md section 2).
#pragma once

#include <array>

#include "kernels/tracing/rows.h"

namespace arah {

// J = ∂x_bar/∂x = Σ_b w_b R_b + cube_scale · (∂x_bar_i/∂n through the weights), metres per metre.
// gradients[i]: what record_lbs_backward(component = i) and the network's backward pass leave at the network's input.
struct JacobianArgs {
  PointRange range;
  BufferSlice frame;                // FrameConstants
  BufferSlice transforms;           // three vec4 by row: of record_lbs
  std::array<Matrix, 3> gradients;  // by row [3]: ∂x_bar_i/∂n, metres per cube unit
  BufferSlice jacobians;            // out, three vec4 by row: row i = ∂x_bar_i/∂x, w = 0
};
void record_jacobian(Commands& commands, const JacobianArgs& args);

}  // namespace arah
