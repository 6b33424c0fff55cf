// Whether a tensor's numbers are what they should be: how many are NaN, infinite or out of their range, and which is the first
// (reference::watch). A reading of each number, and writing only where one is bad.
#pragma once

#include <limits>

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"
#include "shaders/shared/watch.h"

namespace arah {

struct WatchArgs {
  const char* name = "";  // of the tensor, for the profile
  Matrix values;               // float32; stride and column multiples of 4, or `channels` 1 and any
  uint32_t rows = 0;           // at least 1; padding rows are not looked at
  uint32_t channels = 1;       // of each row, from values.column on: 1 to 4
  float limit = std::numeric_limits<float>::infinity();  // above 0: finite numbers of a greater magnitude are bad too
  BufferSlice points;  // vec4 by row: only rows with w > 0 count. Empty: all do
  // Row r has the number first_row + row_ids[r] (uint32 by row), or where that is empty first_row + r, and channel k of row
  // number n the place n · channels + k, below 2³² − 1.
  BufferSlice row_ids;
  uint32_t first_row = 0;
  // shared::WatchRecord: += its counts, and the first place of those before and now. Zero it before the first use.
  BufferSlice record;
  bool after_previous = true;  // false: nothing that the launch before it wrote is read
};

// Throws std::invalid_argument where rows, channels, stride or column are not as above, or the values are of halves.
void record_watch(Commands& commands, const WatchArgs& args);

// Where something is bad, the place of the first.
inline uint32_t first_place(const shared::WatchRecord& record) { return ~record.first_inverted; }

}  // namespace arah
