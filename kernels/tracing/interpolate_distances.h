// Signed distances from a grid of them, instead of a network (reference::interpolate_value).
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/rays/shell_bins.h"

namespace arah {

// A box of nodes in canonical space and the signed distances there. The unit is the caller's.
struct DistanceNodes {
  ShellGrid grid;
  BufferSlice distances;  // [padded_points(nodes)] float
};

struct InterpolateDistancesArgs {
  uint32_t rows = 0;
  BufferSlice points;  // vec4 by row: canonical, metres
  DistanceNodes nodes;
  BufferSlice interpolated;  // out, [padded_points(rows)] vec4: x = the distance; zeros in the padding
};
void record_interpolate_distances(Commands& commands, const InterpolateDistancesArgs& args);

}  // namespace arah
