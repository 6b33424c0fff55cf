// Which part of each ray lies in the shell around the posed template, where samples are worth their cost.
#pragma once

#include <array>

#include "kernels/vulkan/commands.h"
#include "shaders/shared/shell_grid.h"

namespace arah {

using shared::ShellGrid;

// Nodes of the whole grid. Throws std::invalid_argument naming the axis with fewer than 2, or where they are more than
// 2^31 - 1.
uint32_t node_count(const ShellGrid& grid);

struct ShellBinsArgs {
  uint32_t count = 0;                       // rays
  std::array<float, 3> root_translation{};  // metres, world
  ShellGrid grid;                           // posed space: world minus the root translation
  float outer = 0.055F;                     // metres: bins whose centre is farther outside are dropped
  float inner = 0.03F;                      // metres: the first bin whose centre is deeper inside is the last kept
  BufferSlice rays;                         // [count] Ray (shaders/shared/ray.h)
  BufferSlice distances;                    // [padded_points(nodes)] float, metres: signed distance to the posed template
  // out: [padded_points(count)] uvec2: bit i of the 64 keeps the i-th of the ray's 64 equal bins from near to far. The
  // distance at a bin's centre is interpolated trilinearly; outside the grid is far. 0 for rays that miss the box.
  BufferSlice kept;
  BufferSlice kept_counts;  // out: [padded_points(count)] uint32: the number of kept bins
};

void record_shell_bins(Commands& commands, const ShellBinsArgs& args);

}  // namespace arah
