// The start of a root search.
#pragma once

#include "kernels/tracing/broyden_state.h"
#include "kernels/tracing/rows.h"

namespace arah {

// Residual, inverse Jacobian and first step at the start. A point has diverged where the start, its residual or the inverse
// Jacobian is not finite. Else a step follows, unless start_tolerance says that the start is good enough.
struct BroydenStartArgs {
  Rows rows;
  BroydenState state;      // with rows.ids: all other points become "never started"
  BufferSlice frame;       // FrameConstants
  BufferSlice starts;      // vec4 by point: x, metres
  BufferSlice posed;       // vec4 by row: of record_lbs at the start
  BufferSlice transforms;  // three vec4 by row: of record_lbs at the start
  BufferSlice targets;     // vec4 by point: the posed point; Unknowns::point alone
  RaySurface surface;      // this and the next three: Unknowns::point_and_depth alone
  BufferSlice depths;      // vec4 by point: x = the start's depth, metres (the trace of sphere tracing)
  Matrix sdf_gradients;    // by row, channels 0..2: ∂f/∂n
  BufferSlice jacobians;   // three vec4 by row: of record_jacobian at the start
  BufferSlice active;      // out, uint32 by row: 1 where the search goes on
  uint32_t max_iterations = 50;
  float start_tolerance = 0;  // metres: a start whose residual is smaller is a root; 0: none is (the paper)
};
void record_broyden_start(Commands& commands, const BroydenStartArgs& args);

}  // namespace arah
