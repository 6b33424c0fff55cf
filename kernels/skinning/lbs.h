// Linear blend skinning of canonical points with the skinning network's weights (paper, section 3.2; ARAH.md section
// 2).
#pragma once

#include "kernels/skinning/joint_tree.h"
#include "kernels/tracing/rows.h"

namespace arah {

// x_bar = Σ_b w_b B_b x with w = hierarchical softmax of 20 · logits. Finite at any finite logits; NaN where one is
// not. Rows past the count become zeros.
struct LbsArgs {
  const JointTree* tree = nullptr;
  Rows rows;
  Matrix logits;           // by row [tree.logits()]: the network's output, before the factor 20
  BufferSlice frame;       // FrameConstants
  BufferSlice canonical;   // vec4 by point: x, metres
  BufferSlice posed;       // out, vec4 by row: x_bar − t, metres, without the root translation; w = 0
  BufferSlice transforms;  // out, three vec4 by row: the rows of Σ_b w_b B_b; or empty
  Matrix weights;          // out, by row [joints], padding columns 0; or empty
};
void record_lbs(Commands& commands, const LbsArgs& args);

}  // namespace arah
