// Signed distances that were evaluated for a queue of samples, back to the samples' rows.
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

struct ScatterDistancesArgs {
  uint32_t count = 0;     // samples in the queue
  BufferSlice samples;    // uint32 [padded_points(count)]: the row of each slot's sample
  Matrix sdf;             // by slot, channel 0; stride and column are multiples of 4
  BufferSlice distances;  // out, vec4 by row: x = the distance; other rows stay as they are
};
void record_scatter_distances(Commands& commands, const ScatterDistancesArgs& args);

}  // namespace arah
