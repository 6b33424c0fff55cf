// The gradient at a canonical point from the paths that lead through its normalised coordinates.
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// upstream = cube_scale · (through_sdf + direct): from per cube unit to per metre.
struct PositionGradientArgs {
  uint32_t points = 0;
  BufferSlice frame;    // FrameConstants
  Matrix through_sdf;   // [points][3]: dL/dn through the sdf network
  BufferSlice direct;   // vec4 by point: dL/dn of the colour network's own input and of the feature grid
  BufferSlice upstream; // out, vec4 by point: dL/dx̂, w = 0
};
void record_position_gradient(Commands& commands, const PositionGradientArgs& args);

}  // namespace arah
