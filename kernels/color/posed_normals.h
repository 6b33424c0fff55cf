// Normals of samples, turned from canonical to posed space or left as they are.
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// normal = T₃ₓ₃ ∇f, divided by its length with unit_length (a zero gradient stays zero).
struct PosedNormalsArgs {
  uint32_t rows = 0;
  Matrix gradients;        // [rows][3]: ∂f/∂n of the sdf network
  BufferSlice transforms;  // three vec4 by row: of record_lbs; empty: T is the identity
  BufferSlice normals;     // out, vec4 by row, w = 0
  bool unit_length = true;
};
void record_posed_normals(Commands& commands, const PosedNormalsArgs& args);

}  // namespace arah
