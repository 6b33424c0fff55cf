// Gradients through the correspondence search by the implicit function theorem (paper, appendix "Implicit Gradients";
// kernels/reference/implicit.h).
#pragma once

#include "kernels/tracing/rows.h"
#include "shaders/shared/skinning.h"

namespace arah {

// g = −J⁻ᵀ dL/dx at each root x: the cotangent on LBS(x), the argument of record_lbs_backward, with x held fixed; shortened to
// 100 |dL/dx| where it is longer (reference::most_amplification); those are counted.
// 0 for points without a root, for padding rows, and where J has no inverse in float32 (|det J| ≤ 4e-7 · the product of
// its rows' lengths, or not finite); the last are counted too.
struct ImplicitCotangentArgs {
  uint32_t points = 0;
  BufferSlice jacobians;       // three vec4 by point: of record_jacobian
  BufferSlice upstream;        // vec4 by point: dL/dx, per metre
  BufferSlice canonical;       // vec4 by point: w > 0 with a root
  BufferSlice cotangents;      // out, vec4 by point
  BufferSlice counts;          // one shared::ImplicitCounts, +=
};
void record_implicit_cotangent(Commands& commands, const ImplicitCotangentArgs& args);

}  // namespace arah
