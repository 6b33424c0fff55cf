// Compaction: the points of the flagged rows, in order, and their number, without the host's help.
#pragma once

#include "kernels/tracing/rows.h"

namespace arah {

// Rows that one workgroup looks at (lib/flags.glsl).
inline constexpr uint32_t compact_block = 2048;
inline constexpr uint32_t compact_most_rows = 4u << 20;
constexpr uint32_t compact_blocks(uint32_t rows) {
  return rows == 0 ? 1 : (rows + compact_block - 1) / compact_block;
}

// `compacted` gets the points of the flagged rows in the order of the rows, padded with a point of the list to a
// multiple of 64; `count` becomes their WorkCount. compacted and count must not be rows.ids and rows.range.indirect.
// Throws std::invalid_argument where rows.range.points is more than compact_most_rows.
struct CompactArgs {
  Rows rows;                   // at most compact_most_rows
  BufferSlice flags;           // uint32 by row, set where not 0; or empty and
  BufferSlice flagged_points;  // vec4 by row, set where w > 0
  BufferSlice scratch;         // uint32 [compact_blocks(rows.range.points)]
  BufferSlice compacted;       // out, uint32 by row
  BufferSlice count;           // out, WorkCount
};
void record_compact(Commands& commands, const CompactArgs& args);

}  // namespace arah
