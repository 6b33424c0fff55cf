// What the loss says about the pose: the gradient of the bone transforms through linear blend skinning (paper, appendix
// "Implicit Gradients"; kernels/reference/implicit.h).
#pragma once

#include "kernels/tracing/nearest_vertex.h"

namespace arah {

// dL/dB_b += Σ_rows g (w_b [x; 1])ᵀ with g the cotangent on LBS(x) (record_implicit_cotangent). At a root LBS(x) + t is a
// fixed point of space, so dL/dt = Σ_rows g; weights sum to 1, so that is Σ_b of the last columns of dL/dB_b, and no sum of
// its own. Added in a fixed order: 64 rows at a time, then the partial sums.
struct BoneGradientArgs {
  Rows rows;
  uint32_t joints = 0;     // 1..64
  BufferSlice cotangents;  // vec4 by row: g; 0 where there is no root
  BufferSlice canonical;   // vec4 by row: x, metres; finite
  Matrix weights;          // by row [joints]: of record_lbs; or empty, and then …
  BufferSlice nearest;     // … uint32 by point: the vertex whose weights the point has,
  PosedVertices target;    // its joints and weights are read
  BufferSlice partials;    // bone_gradient_partials() bytes
  BufferSlice gradients;   // float [joints][3][4], +=
};
void record_bone_gradient(Commands& commands, const BoneGradientArgs& args);

uint64_t bone_gradient_partials(uint32_t rows, uint32_t joints);  // bytes

}  // namespace arah
