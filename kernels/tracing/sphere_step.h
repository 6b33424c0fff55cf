// Sphere tracing through the approximate backward skinning (ARAH.md section 4; kernels/reference/tracing.h), one
// iteration a launch. The host's loop: record_sphere_start; then, at most 50 times, record_nearest_vertex, the sdf at
// its canonical points, record_sphere_step, record_compact of `active`. The canonical points of the last evaluation and
// the depths after the last step start the joint search.
#pragma once

#include "kernels/tracing/rows.h"

namespace arah {

// What both kernels read and write.
struct SphereTracing {
  BufferSlice frame;       // FrameConstants
  BufferSlice rays;        // Ray by point (= by ray)
  BufferSlice kept;        // uvec2 by ray: its bins in the template's shell (kernels/rays/shell_bins.h), behind the last of which it is
                           // not followed; empty: followed to its far end
  bool from_shell = false; // with kept: begins where the ray enters the shell, not at its near end
  BufferSlice trace;       // vec4 by point: depth, sdf at the last evaluated point (both metres), evaluations, status
                           // (0 under way, 1 on the surface, 2 diverged: depth ≥ its end, or an sdf that is not finite)
  BufferSlice posed;       // out, vec4 by point: c + depth · v − t, w = 1
  BufferSlice candidates;  // out, uint32 by point: 1 unless diverged; the rays of the joint search in evaluation
  BufferSlice active;      // out, uint32 by row: 1 where the ray goes on
};

// Puts the rays at their near ends, or where they enter the shell. A ray that misses the box (near ≥ far) or the shell is diverged at once.
void record_sphere_start(Commands& commands, const Rows& rows, const SphereTracing& tracing);

struct SphereStepArgs {
  Rows rows;
  SphereTracing tracing;
  Matrix sdf;               // by row, channel 0: f in cube units at the canonical point of tracing.posed
  float max_step = 0.1f;    // metres, in both directions
  float tolerance = 1e-5f;  // metres
};
void record_sphere_step(Commands& commands, const SphereStepArgs& args);

}  // namespace arah
