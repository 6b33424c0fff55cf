// Where sphere tracing gives up on a ray: at its far end, or, where the bins of rays in the template's shell are given, where the
// ray leaves the shell for the last time (kernels/rays/shell_bins.h; bit i: the i-th of its 64 equal bins). A ray without a bin ends
// where it begins.
#ifndef ARAH_LIB_TRACE_END_GLSL
#define ARAH_LIB_TRACE_END_GLSL

layout(constant_id = 2) const int HAS_KEPT = 0;
layout(binding = 8, scalar) restrict readonly buffer Kept { uvec2 kept[]; };

float trace_end(int ray, float near, float far) {
  if (HAS_KEPT == 0) return far;
  const uvec2 bits = kept[ray];
  const int last = bits.y != 0u ? 32 + findMSB(bits.y) : findMSB(bits.x);  // -1: none
  return last == 63 ? far : near + float(last + 1) * ((far - near) / 64.0);
}

#endif
