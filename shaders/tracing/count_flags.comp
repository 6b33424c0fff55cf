// First pass of compaction: each workgroup counts the flagged rows of its block.
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
layout(binding = 4, scalar) restrict writeonly buffer BlockCounts { uint block_counts[]; };
layout(push_constant, scalar) uniform Constants { CompactConstants constants; };

void main() {
  const uint first = gl_WorkGroupID.x * FLAGS_A_BLOCK + gl_LocalInvocationIndex * FLAGS_AN_INVOCATION;
  uint total;
  exclusive_scan(uint(bitCount(flag_mask(first, row_count(constants.row_limit)))), total);
  if (gl_LocalInvocationIndex == 0u) block_counts[gl_WorkGroupID.x] = total;
}
