// One step of a root search.
#pragma once

#include "kernels/tracing/broyden_state.h"
#include "kernels/tracing/rows.h"

namespace arah {

// Takes the residual at state.iterates() of the rows' points, keeps the best iterate, and writes the next one. Rows
// whose points have ended are left alone, so that compaction may come as seldom as the caller likes.
struct BroydenStepArgs {
  Rows rows;
  BroydenState state;
  BufferSlice frame;       // FrameConstants
  BufferSlice posed;       // vec4 by row: of record_lbs at the iterate
  BufferSlice transforms;  // three vec4 by row: of record_lbs at the iterate; with state.keeps_transforms, else empty
  BufferSlice targets;     // vec4 by point: the posed point; Unknowns::point alone
  RaySurface surface;      // Unknowns::point_and_depth alone
  BufferSlice active;      // out, uint32 by row: 1 where the search goes on
  uint32_t max_iterations = 50;
  float tolerance = 1e-5f;           // metres: converged where the best residual's norm is below
  float divergence = 1;              // metres: given up where the current residual's norm is not below
  float denominator_offset = 1e-6f;  // added to the update's denominator, away from zero
};
void record_broyden_step(Commands& commands, const BroydenStepArgs& args);

}  // namespace arah
