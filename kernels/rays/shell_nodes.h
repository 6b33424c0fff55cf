// The nodes of the grid around a posed template, as points.
#pragma once

#include "kernels/vulkan/commands.h"
#include "shaders/shared/shell_grid.h"

namespace arah {

using shared::ShellGrid;

// Nodes of the whole grid. Throws std::invalid_argument naming the axis with fewer than 2, or where they are more than
// 2^31 - 1.
uint32_t node_count(const ShellGrid& grid);

struct ShellNodesArgs {
  ShellGrid grid;      // posed space, metres
  BufferSlice points;  // out: [padded_points(nodes)] vec4 (position, 1); the padding repeats the last node
};

void record_shell_nodes(Commands& commands, const ShellNodesArgs& args);

}  // namespace arah
