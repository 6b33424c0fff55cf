// The skinning loss: the network's weights against the template's on points of its surface (ARAH.md section 7).
#pragma once

#include "kernels/skinning/joint_tree.h"
#include "kernels/tracing/rows.h"

namespace arah {

// How far the weights w are from the targets. cross_entropy, −Σ target log(w + 1e-12), still pulls where the gates have closed
// and the absolute difference has no slope left: fits from scratch need it (docs/decisions/skinning-fit.md).
enum class WeightsMeasure : uint32_t { absolute, cross_entropy };

// weight / points · Σ_points Σ_b |w_b − target_b| (or the cross entropy), added to losses[slot] in a fixed order, and its gradient at the
// logits (assigned; padding rows and columns 0; at w_b = target_b the derivative of |·| is 0).
struct WeightsLossArgs {
  const JointTree* tree = nullptr;
  WeightsMeasure measure = WeightsMeasure::absolute;
  uint32_t points = 0;
  Matrix logits;               // [points][tree.logits()]: the network's output, before the factor 20
  BufferSlice target_joints;   // uint32 by point: four joints of 8 bits, the first in the lowest bits
  BufferSlice target_weights;  // vec4 by point; a joint named twice counts twice, an unused place has weight 0
  float weight = 1;
  Matrix d_logits;      // out, [points][tree.logits()]
  BufferSlice scratch;  // partial_bytes(points) of kernels/reduction/sum.h
  BufferSlice losses;   // float [terms]
  uint32_t slot = 0;
};
void record_weights_loss(Commands& commands, const WeightsLossArgs& args);

}  // namespace arah
