// Which part of each ray lies in the shell around the posed template, where samples are worth their cost.
#pragma once

#include <array>

#include "kernels/rays/shell_nodes.h"

namespace arah {

struct ShellBinsArgs {
  uint32_t count = 0;                       // rays
  std::array<float, 3> root_translation{};  // metres, world
  ShellGrid grid;                           // posed space: world minus the root translation
  float outer = 0.055F;                     // metres: bins whose centre is farther outside are dropped
  float inner = 0.03F;                      // metres: the first bin whose centre is deeper inside is the last kept
  BufferSlice rays;                         // [count] Ray (shaders/shared/ray.h)
  BufferSlice distances;                    // [padded_points(nodes)] float, metres (record_shell_distance)
  // out: [padded_points(count)] uvec2: bit i of the 64 keeps the i-th of the ray's 64 equal bins from near to far. The
  // distance at a bin's centre is interpolated trilinearly; outside the grid is far. 0 for rays that miss the box.
  BufferSlice kept;
  BufferSlice kept_counts;  // out: [padded_points(count)] uint32: the number of kept bins
};

void record_shell_bins(Commands& commands, const ShellBinsArgs& args);

}  // namespace arah
