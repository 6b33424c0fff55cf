// The way back through linear blend skinning, the bone transforms held fixed.
#pragma once

#include "kernels/skinning/joint_tree.h"
#include "kernels/tracing/rows.h"

namespace arah {

// From g = dL/dx_bar to dL/dlogits and to Σ_b w_b R_bᵀ g, the part of dL/dx that does not pass through the weights; the
// rest comes from d_logits through the network. All outputs are assigned; rows past the count become zeros.
struct LbsBackwardArgs {
  const JointTree* tree = nullptr;
  Rows rows;
  Matrix logits;            // by row [tree.logits()]: the network's output, before the factor 20
  BufferSlice frame;        // FrameConstants
  BufferSlice canonical;    // vec4 by point: x, metres
  BufferSlice cotangents;   // vec4 by row: g; empty with `component` < 3
  uint32_t component = 3;   // 0, 1, 2: g is that unit vector, for a row of the Jacobian; 3: g is read
  Matrix d_logits;          // out, by row [tree.logits()], before the factor 20, padding columns 0
  BufferSlice d_canonical;  // out, vec4 by row: the direct part of dL/dx, per metre, w = 0; or empty
};
void record_lbs_backward(Commands& commands, const LbsBackwardArgs& args);

}  // namespace arah
