// How fast the device reads and writes its memory: a yardstick for the other kernels' GB/s.
#pragma once

#include "kernels/vulkan/commands.h"

namespace arah {

struct BandwidthPeakArgs {
  uint32_t workgroups = 0;  // each writes 64 rows of eight floats
  uint32_t reads = 1;       // rows read for a written one, 1 to 64: 1 copies
  BufferSlice rows;         // float [64 · workgroups · reads][8]
  BufferSlice sums;         // out, float [64 · workgroups][8]: row 8 g + i is the sum of rows 8 (g · reads + r) + i over r < reads, i < 8
};
// Throws std::invalid_argument for another number of reads.
void record_bandwidth_peak(Commands& commands, const BandwidthPeakArgs& args);

}  // namespace arah
