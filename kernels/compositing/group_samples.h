// Samples of a ray in groups that share one colour (reference::group_samples).
#pragma once

#include "kernels/vulkan/commands.h"

namespace arah {

struct GroupSamplesArgs {
  uint32_t rays = 0;
  uint32_t samples = 0;    // of each ray, at most 30,000
  uint32_t groups = 1;     // of equal weight, of each ray; at least 1
  float least_weight = 0;  // samples with no more than this belong to no group
  float near = 0.02F;      // metres between canonical points of one group, at most
  BufferSlice weights;     // [rows] float, 0 where there is no sample
  BufferSlice points;      // [rows] vec4: canonical, metres. Read and written: the first sample of a group moves to the group's place
  BufferSlice flags;       // out, [rows] uint: 1 for the first sample of each group
};
void record_group_samples(Commands& commands, const GroupSamplesArgs& args);

}  // namespace arah
