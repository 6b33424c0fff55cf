// Tests for NaN and infinity on the bits: compilers with fast arithmetic may drop isnan and comparisons with oneself.
#ifndef ARAH_LIB_FINITE_GLSL
#define ARAH_LIB_FINITE_GLSL

bool is_finite(float value) { return (floatBitsToUint(value) & 0x7f800000u) != 0x7f800000u; }
bool is_finite(vec3 value) { return is_finite(value.x) && is_finite(value.y) && is_finite(value.z); }
bool is_finite(vec4 value) { return is_finite(value.xyz) && is_finite(value.w); }

#endif
