// Second pass of compaction: each workgroup adds up the counts of the blocks before its own and writes the points of its
// flagged rows from there on, in order. The last one also writes the new count and repeats a valid point up to the next
// multiple of 64 rows, so that kernels may look up the padding rows too.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#define ROWS_CONSTANT 0
#include "lib/flags.glsl"
#include "lib/rows.glsl"
#include "lib/scan.glsl"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 4, scalar) restrict readonly buffer BlockCounts { uint block_counts[]; };
layout(binding = 5, scalar) restrict writeonly buffer Compacted { uint compacted[]; };
layout(binding = 6, scalar) restrict writeonly buffer Count { WorkCount compacted_work; };
layout(push_constant, scalar) uniform Constants { CompactConstants constants; };

void main() {
  const uint block = gl_WorkGroupID.x, lane = gl_LocalInvocationIndex;
  const uint first = block * FLAGS_A_BLOCK + lane * FLAGS_AN_INVOCATION;
  const uint mask = flag_mask(first, row_count(constants.row_limit));

  uint counted = 0u, before, own;
  for (uint i = lane; i < block; i += 64u) counted += block_counts[i];
  exclusive_scan(counted, before);
  uint at = before + exclusive_scan(uint(bitCount(mask)), own);
  for (uint left = mask; left != 0u; left &= left - 1u) compacted[at++] = uint(point_of_row(first + uint(findLSB(left))));

  if (block == gl_NumWorkGroups.x - 1u) {
    const uint count = before + own, groups = (count + 63u) / 64u;
    if (count + lane < 64u * groups) compacted[count + lane] = uint(point_of_row(0u));
    if (lane == 0u) compacted_work = WorkCount(groups, 1u, 1u, count);
  }
}
