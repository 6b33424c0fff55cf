// Gradients through the joint search of canonical point and depth by the implicit function theorem (paper, appendix
// "Implicit Gradients"; kernels/reference/implicit.h): what surface rendering learns its geometry from.
#pragma once

#include "kernels/tracing/rows.h"
#include "shaders/shared/skinning.h"

namespace arah {

// −J⁻ᵀ dL/d(x, d) at each root, J = [[∇f_metric, 0], [∂LBS/∂x, −v]]: the cotangents on the network's f (the argument of
// Siren::record_backward) and on LBS(x) (of record_lbs_backward), x and d held fixed. With g the cotangent on LBS(x), that
// on the camera's centre is −g, on the direction −d g, on the root translation g. All four together, in metres, are shortened to
// 100 |dL/d(x, d)| where they are longer (reference::most_amplification); those are counted.
// `rays` rows, one a ray. 0 for rays without a root, for padding rows, and where J has no inverse in float32 (|det J| ≤ 1e-6 · the product of its
// rows' lengths, or not finite; a ray that grazes the surface); the last are counted too.
struct ImplicitJointCotangentArgs {
  uint32_t rays = 0;
  BufferSlice frame;           // FrameConstants
  BufferSlice ray_list;        // Ray by ray, or where `of_row` is given, the list that its numbers are of
  Matrix sdf_gradients;        // by ray, channels 0..2: ∂f/∂n
  BufferSlice jacobians;       // three vec4 by ray: of record_jacobian
  BufferSlice upstream;        // vec4 by ray: dL/dx per metre, dL/dd per metre
  BufferSlice canonical;       // vec4 by ray: w > 0 with a root
  BufferSlice cotangents;      // out, vec4 by ray: on LBS(x)
  Matrix sdf_cotangents;       // out, by ray, channels 0..3: on f in cube units, then zeros
  BufferSlice counts;          // one shared::ImplicitCounts, +=
  BufferSlice of_row = {};     // uint32 by row, padding included; empty: row r is ray r
  uint32_t listed = 0;         // with `of_row`: rays in the list
};
void record_implicit_joint_cotangent(Commands& commands, const ImplicitJointCotangentArgs& args);

}  // namespace arah
