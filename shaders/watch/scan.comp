// Counts the numbers of a tensor that are NaN, infinite, or finite but of a magnitude above a limit, and finds the place of the
// first of them (kernels/watch/scan.h). One invocation reads one row. Where nothing is bad nothing is written; else integers
// are added and compared with atomics, whose result does not depend on their order.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/elements.glsl"
#include "shared/watch.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const bool TEXELS = true;   // rows begin at texels of four; else each is one number
layout(constant_id = 1) const bool POINTS = false;  // only rows whose point has w > 0 count
layout(constant_id = 2) const bool INDEXED = false; // row r has the number row_ids[r], else r

layout(push_constant, scalar) uniform Constants { WatchConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer values;
layout(binding = 1, rgba32f) uniform readonly imageBuffer points;
layout(binding = 2, scalar) readonly buffer RowIds { uint row_ids[]; };
layout(binding = 3, scalar) buffer Record { WatchRecord record; };

const uint infinity = 0x7f800000u;

uint count(bvec4 which) { return uint(which.x) + uint(which.y) + uint(which.z) + uint(which.w); }

void main() {
  uint row = gl_GlobalInvocationID.x;
  uint at = min(row, c.rows - 1u);
  vec4 value = vec4(0.0);
  if (TEXELS) value = imageLoad(values, int(at * (c.stride / 4u) + c.column / 4u));
  else value.x = ELEMENT(values, at * c.stride + c.column);
  bool counts = row < c.rows;
  if (POINTS) counts = counts && imageLoad(points, int(at)).w > 0.0;
  // Floats of one sign are ordered as their bits are, so that magnitudes are compared as integers: no fast-math assumption
  // touches them.
  uvec4 magnitude = floatBitsToUint(value) & 0x7fffffffu;
  magnitude = mix(uvec4(0u), magnitude, lessThan(uvec4(0u, 1u, 2u, 3u), uvec4(c.channels)));
  bvec4 bad = greaterThan(magnitude, uvec4(min(floatBitsToUint(c.limit), infinity - 1u)));
  if (!counts || !any(bad)) return;
  uint nans = count(greaterThan(magnitude, uvec4(infinity)));
  uint infinite = count(equal(magnitude, uvec4(infinity)));
  uint channel = bad.x ? 0u : bad.y ? 1u : bad.z ? 2u : 3u;
  uint number = c.first_row + (INDEXED ? row_ids[at] : row);
  if (nans > 0u) atomicAdd(record.nan, nans);
  if (infinite > 0u) atomicAdd(record.infinite, infinite);
  if (count(bad) > nans + infinite) atomicAdd(record.beyond, count(bad) - nans - infinite);
  atomicMax(record.first_inverted, ~(number * c.channels + channel));
}
