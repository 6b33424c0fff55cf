// Correspondences from a grid of them, instead of a search (reference::interpolate_correspondence).
#pragma once

#include "kernels/tracing/rows.h"
#include "shaders/shared/shell_grid.h"

namespace arah {

// A box of nodes in posed space, some of which have a canonical correspondence.
struct CorrespondenceNodes {
  shared::ShellGrid grid;
  float longest = 0;      // metres between the canonical points of neighbouring nodes, at most: beyond, nothing lies between
  BufferSlice slots;      // uint32 by node: where in `canonical` its correspondence stands; 0: it has none
  BufferSlice canonical;  // vec4 by slot, metres; w > 0: found. Slot 0 holds zeros
};

struct InterpolateCorrespondencesArgs {
  uint32_t points = 0;
  BufferSlice targets;  // vec4 by point: posed space, metres; w > 0: wanted
  CorrespondenceNodes nodes;
  BufferSlice interpolated;  // out, vec4 by point: canonical, metres, w = 1; zeros where there is none
  BufferSlice flags;         // out, uint32 by point: 1 where it is wanted and the grid cannot tell
};
void record_interpolate_correspondences(Commands& commands, const InterpolateCorrespondencesArgs& args);

}  // namespace arah
