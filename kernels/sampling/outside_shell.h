// Samples outside the shell around the posed template: nothing can be there, so nothing needs to be searched or evaluated.
#pragma once

#include "kernels/rays/shell_bins.h"

namespace arah {

// Where a point is wanted (w > 0) and farther than `outer` from the posed template, or outside the grid, its w becomes
// shared::EMPTY (shaders/shared/empty_sample.h).
struct OutsideShellArgs {
  uint32_t rows = 0;
  ShellGrid grid;         // posed space: world minus the root translation
  float outer = 0.055F;   // metres
  BufferSlice distances;  // [padded_points(nodes)] float, metres: signed distance to the posed template
  BufferSlice points;     // vec4 by row, read and written
};
void record_outside_shell(Commands& commands, const OutsideShellArgs& args);

}  // namespace arah
