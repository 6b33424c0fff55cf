// Input rows of the networks that read a canonical point.
#pragma once

#include "kernels/tracing/rows.h"

namespace arah {

// n(x) = x · cube_scale + cube_offset in channels 0..2 and zeros in 3..7; rows past the count hold zeros. from_root: of
// B_0⁻¹ x with the rigid transform of joint 0: a posed point in the axes that its root joint has in the canonical pose.
struct NormaliseInputsArgs {
  Rows rows;
  BufferSlice frame;      // FrameConstants
  BufferSlice canonical;  // vec4 by point: x, metres
  Matrix inputs;          // out, by row [8]
  bool from_root = false;
};
void record_normalise_inputs(Commands& commands, const NormaliseInputsArgs& args);

}  // namespace arah
