// Normal loss Σ (1 − cos(∇f, n)) / N on the surface (reference::normal_loss; ARAH.md section 10).
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

struct NormalLossArgs {
  uint32_t points = 0;
  float normaliser = 1;  // N
  float weight = 0;
  Matrix gradients;     // [points][3]: ∇f of the sdf network; stride and column are multiples of 4
  BufferSlice normals;  // [points] vec4: outward unit normals in xyz
  Matrix d_gradients;   // [points][3], += the weighted gradient: after record_eikonal_loss, which assigns
  BufferSlice losses;   // float: the unweighted value is added (+=) at `slot`
  uint32_t slot = 0;
  BufferSlice partials;  // scratch: partial_bytes(points) (kernels/reduction/sum.h)
};

// Throws std::invalid_argument where a stride or column is no multiple of 4.
void record_normal_loss(Commands& commands, const NormalLossArgs& args);

}  // namespace arah
