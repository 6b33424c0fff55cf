// The search for canonical points that Broyden's method did not find (reference::find_root_damped), by row of a list of points.
// The host's loop: record_mark_unsolved, record_compact; record_damped_newton_start; then LBS and its Jacobian at the trials and
// record_damped_newton, as often as wanted.
#pragma once

#include "kernels/tracing/rows.h"
#include "shaders/shared/tracing.h"

namespace arah {

using shared::DampedNewtonCounts;

// flags: out, uint32 by point: 1 where it is wanted (target's w > 0) and has no root (canonical's w = 0).
struct MarkUnsolvedArgs {
  uint32_t points = 0;
  BufferSlice targets, canonical;  // vec4 by point
  BufferSlice flags;
};
void record_mark_unsolved(Commands& commands, const MarkUnsolvedArgs& args);

inline constexpr uint64_t damped_newton_state_bytes = 16 * 5;  // by row

struct DampedNewtonArgs {
  Rows rows;              // with ids; the points that are searched
  BufferSlice state;      // damped_newton_state_bytes by row
  BufferSlice trials;     // vec4 by row: the iterate to be evaluated next; w = 1 while the row's search goes on
  BufferSlice starts;     // vec4 by point; of the start alone
  BufferSlice posed;      // vec4 by row: LBS of the trial
  BufferSlice jacobians;  // three vec4 by row: its Jacobian
  BufferSlice targets;    // vec4 by point
  BufferSlice canonical;  // vec4 by point: a root is written there, w = 1
  BufferSlice counts;     // DampedNewtonCounts: found and steps are added to, searching is of the last call alone where it was 0 before
  float tolerance = 1e-5f;  // metres
};
// Points that have a root already are not searched.
void record_damped_newton_start(Commands& commands, const DampedNewtonArgs& args);
void record_damped_newton(Commands& commands, const DampedNewtonArgs& args);

}  // namespace arah
