// Tests for NaN and infinity on the bits: compilers with fast arithmetic may drop isnan and comparisons with oneself.
#ifndef ARAH_LIB_FINITE_GLSL
#define ARAH_LIB_FINITE_GLSL

bool is_finite(float value) { return (floatBitsToUint(value) & 0x7f800000u) != 0x7f800000u; }
bool is_finite(vec3 value) { return is_finite(value.x) && is_finite(value.y) && is_finite(value.z); }
bool is_finite(vec4 value) { return is_finite(value.xyz) && is_finite(value.w); }

bool is_nan(float value) { return (floatBitsToUint(value) & 0x7fffffffu) > 0x7f800000u; }
bvec4 is_nan(vec4 value) { return greaterThan(floatBitsToUint(value) & 0x7fffffffu, uvec4(0x7f800000u)); }

// max(x, 0) and clamp that hand a NaN on: the built-in ones may give the other operand (lavapipe does), and a number that is
// wrong would look right.
float relu(float x) { return is_nan(x) ? x : max(x, 0.0); }
vec4 relu(vec4 x) { return mix(max(x, vec4(0)), x, is_nan(x)); }
float clamped(float x, float low, float high) { return is_nan(x) ? x : clamp(x, low, high); }

#endif
