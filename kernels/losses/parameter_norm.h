// Regulariser on the parameters that a pose's SIREN is made of: |φ|₂ / n over all its weight matrices, biases not counted
// (reference::parameter_loss; ARAH.md sections 0.3 and 7).
#pragma once

#include <vector>

#include "kernels/vulkan/commands.h"

namespace arah {

struct ParameterNormArgs {
  struct Part {
    BufferSlice phi;    // float, padded with zeros to a multiple of 64
    BufferSlice d_phi;  // +=: float, the weighted gradient
    uint64_t numbers = 0;  // without padding
  };
  std::vector<Part> parts;
  float weight = 0;
  BufferSlice losses;  // float: the unweighted value is added (+=) at `slot`
  uint32_t slot = 0;
  BufferSlice partials;  // scratch: shared::SquaresPartial, squares_partials() of each part together
  BufferSlice norm;      // scratch: one shared::GradientNorm
};

void record_parameter_norm(Commands& commands, const ParameterNormArgs& args);

}  // namespace arah
