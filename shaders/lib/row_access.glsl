// Rows of floats that are read as texels of four and stored as words of eight, also where a part of the row begins
// between texels.
#ifndef ARAH_LIB_ROW_ACCESS_GLSL
#define ARAH_LIB_ROW_ACCESS_GLSL

// Eight floats as the one 32-byte word by which rows are stored.
u64vec4 pack_floats(vec4 low, vec4 high) {
  const uvec4 l = floatBitsToUint(low), h = floatBitsToUint(high);
  return u64vec4(packUint2x32(l.xy), packUint2x32(l.zw), packUint2x32(h.xy), packUint2x32(h.zw));
}

// Four of the eight values of neighbouring texels, beginning with number `shift` (0 to 3) of the first; a constant shift.
vec4 shifted(vec4 a, vec4 b, int shift) {
  if (shift == 0) return a;
  if (shift == 1) return vec4(a.yzw, b.x);
  if (shift == 2) return vec4(a.zw, b.xy);
  return vec4(a.w, b.xyz);
}

#endif
