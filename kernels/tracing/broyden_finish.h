// The end of a root search: its results and what became of its points.
#pragma once

#include "kernels/tracing/broyden_state.h"
#include "kernels/tracing/rows.h"
#include "shaders/shared/tracing.h"

namespace arah {

struct BroydenFinishArgs {
  uint32_t points = 0;
  BroydenState state;
  BufferSlice rays;     // Ray by point; Unknowns::point_and_depth alone
  BufferSlice targets;  // vec4 by point; Unknowns::point alone: where w is shared::EMPTY, so is the result's
  BufferSlice
      canonical;       // out, vec4 by point: the iterate with the smallest residual, metres; w = 1 where it converged
                       // (for rays: within [near, far] too), else 0. Zeros where nothing was started or finite.
  BufferSlice depth;   // out, float by point: its depth, metres; Unknowns::point_and_depth alone
  BufferSlice counts;  // shared::SearchCounts, +=
  // vec4 by point: correspondences that no search was needed for, of record_interpolate_correspondences; where w > 0 they are
  // the result. Or empty.
  BufferSlice interpolated;
};
void record_broyden_finish(Commands& commands, const BroydenFinishArgs& args);

}  // namespace arah
