// The flags that tracing/compact reads: one uint a row, or the w of one vec4 a row, where more than 0 counts as set.
// One invocation looks at FLAGS_AN_INVOCATION neighbouring rows, a workgroup at FLAGS_A_BLOCK (kernels/tracing/compact.h).
#ifndef ARAH_LIB_FLAGS_GLSL
#define ARAH_LIB_FLAGS_GLSL

layout(constant_id = 2) const bool FLAGS_IN_W = false;
layout(binding = 2, scalar) restrict readonly buffer Flags { uint flags[]; };
layout(binding = 3, rgba32f) uniform readonly imageBuffer flagged_points;

const uint FLAGS_AN_INVOCATION = 32u;
const uint FLAGS_A_BLOCK = 64u * FLAGS_AN_INVOCATION;

// Bit i: whether row first + i is flagged. Rows from `count` on are not.
uint flag_mask(uint first, uint count) {
  uint mask = 0u;
  const uint end = min(FLAGS_AN_INVOCATION, max(count, first) - first);
  for (uint i = 0u; i < end; ++i) {
    const bool flagged = FLAGS_IN_W ? imageLoad(flagged_points, int(first + i)).w > 0.0 : flags[first + i] != 0u;
    mask |= flagged ? 1u << i : 0u;
  }
  return mask;
}

#endif
