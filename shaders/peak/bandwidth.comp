// Memory traffic alone: one invocation adds up READS rows of eight floats and writes the sum as one row. Eight neighbouring
// invocations own 8 · READS rows that follow each other and read eight of them at a time, 256 bytes: a whole number of a GPU's
// cache lines, and one stream for a CPU's prefetcher (docs/decisions/device-peak.md). READS = 1 copies; many reads a written
// row are nearly reading alone.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "lib/eight_floats.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint READS = 1u;
layout(binding = 0, rgba32f) uniform readonly imageBuffer rows;  // two texels a row
layout(binding = 1, scalar) restrict writeonly buffer Sums { u64vec4 sums[]; };

void main() {
  const int first = 2 * int(gl_GlobalInvocationID.x / 8u * 8u * READS + gl_GlobalInvocationID.x % 8u);
  EightFloats sum = EightFloats(vec4(0), vec4(0));
  [[unroll]] for (int r = 0; r < int(READS); ++r) {
    sum.low += imageLoad(rows, first + 16 * r);
    sum.high += imageLoad(rows, first + 16 * r + 1);
  }
  sums[gl_GlobalInvocationID.x] = pack_eight(sum);
}
