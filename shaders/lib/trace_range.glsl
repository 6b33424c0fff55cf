// The part of a ray that sphere tracing follows: from its near end to its far end, or, where the bins of rays in the template's
// shell are given (kernels/rays/shell_bins.h; bit i: the i-th of its 64 equal bins), to where the ray leaves the shell for the last
// time, and with FROM_SHELL from where it enters it. Of a ray without a bin nothing.
#ifndef ARAH_LIB_TRACE_RANGE_GLSL
#define ARAH_LIB_TRACE_RANGE_GLSL

layout(constant_id = 2) const int HAS_KEPT = 0;
layout(constant_id = 3) const int FROM_SHELL = 0;
layout(binding = 8, scalar) restrict readonly buffer Kept { uvec2 kept[]; };

float trace_begin(int ray, float near, float far) {
  if (FROM_SHELL == 0) return near;
  const uvec2 bits = kept[ray];
  const int first = bits.x != 0u ? findLSB(bits.x) : bits.y != 0u ? 32 + findLSB(bits.y) : 64;
  return near + float(first) * ((far - near) / 64.0);
}

float trace_end(int ray, float near, float far) {
  if (HAS_KEPT == 0) return far;
  const uvec2 bits = kept[ray];
  const int last = bits.y != 0u ? 32 + findMSB(bits.y) : findMSB(bits.x);  // -1: none
  return last == 63 ? far : near + float(last + 1) * ((far - near) / 64.0);
}

#endif
