// How much a gradient may grow on its way through a search, g = −J⁻ᵀ u (kernels/reference/implicit.h, most_amplification). Its
// includers solve for u / power_of_two_below(u), so that nothing overflows that is finite in the end.
#ifndef ARAH_LIB_AMPLIFICATION_GLSL
#define ARAH_LIB_AMPLIFICATION_GLSL

const float MOST_AMPLIFICATION = 100.0;

float largest_component(vec4 v) { return max(max(abs(v.x), abs(v.y)), max(abs(v.z), abs(v.w))); }

// 2^⌊log2 of the largest component⌋, from 2^-126 to 2^126: to divide by it rounds nothing.
float power_of_two_below(vec4 v) { return uintBitsToFloat(clamp(floatBitsToUint(largest_component(v)) >> 23, 1u, 253u) << 23); }

// What g is multiplied by: 1, exactly, up to |g| = MOST_AMPLIFICATION |u|; beyond, what makes it that long. u: of the order of 1.
float amplification_limit(vec4 g, vec4 u) {
  const float largest = largest_component(g);
  if (!(largest > 1.0)) return 1.0;
  const float growth = largest * (length(g / largest) / length(u));
  return growth > MOST_AMPLIFICATION ? MOST_AMPLIFICATION / growth : 1.0;
}

#endif
