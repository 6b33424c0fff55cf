// A SIREN layer's parameters as a change of low rank of those that all poses share (reference::low_rank_change):
//   W = W₀ + Σ_r h_r u_r v_rᵀ,   b = b₀ + C h
#pragma once

#include "kernels/vulkan/commands.h"

namespace arah {

struct LowRankTensors {
  BufferSlice u;  // float [outputs][rank]; as texels of four, as v and c: slices hold a multiple of four floats
  BufferSlice v;  // float [rank][inputs]
  BufferSlice c;  // float [outputs][rank]
};

struct LowRankArgs {
  uint32_t outputs = 0, inputs = 0, rank = 0;
  LowRankTensors tensors;
  BufferSlice h;              // float; rank of them from first_h on
  uint32_t first_h = 0;
  BufferSlice base_w, base_b; // float [outputs][inputs], [outputs]
  BufferSlice w, b;           // out (=): the same
};
void record_low_rank(Commands& commands, const LowRankArgs& args);

struct LowRankBackwardArgs {
  LowRankArgs forward;       // base_w, base_b, w and b are not read
  BufferSlice d_w, d_b;      // as w and b; d_w as texels of four
  BufferSlice partials;      // scratch: outputs · rank floats
  LowRankTensors gradients;  // +=
  BufferSlice d_h;           // +=: as h
};
void record_low_rank_backward(Commands& commands, const LowRankBackwardArgs& args);

}  // namespace arah
