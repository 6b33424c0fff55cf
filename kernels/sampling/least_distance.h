// Where a ray comes nearest to the surface, of its samples (paper, appendix "Mask Loss": min over d of the SDF).
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// Row of a sample: ray · samples + sample.
struct LeastDistanceArgs {
  uint32_t rays = 0;
  uint32_t samples = 0;  // of each ray, at most 30,000
  Matrix sdf;            // by row, in its first column; stride and column are multiples of 4
  BufferSlice points;    // vec4 by row: canonical, w > 0: the sample has a correspondence
  BufferSlice least;     // out, [padded_points(rays)] vec4: the point of the sample with the least sdf, w = 1; zeros where
                         // no sample has a correspondence
};
void record_least_distance(Commands& commands, const LeastDistanceArgs& args);

}  // namespace arah
