// Eight neighbouring floats read and written as one u64vec4: on a CPU device several times cheaper than two vec4.
// Needs GL_EXT_shader_explicit_arithmetic_types_int64.
#ifndef ARAH_LIB_EIGHT_FLOATS_GLSL
#define ARAH_LIB_EIGHT_FLOATS_GLSL

struct EightFloats {
  vec4 low;
  vec4 high;
};

EightFloats unpack_eight(u64vec4 words) {
  return EightFloats(vec4(uintBitsToFloat(unpackUint2x32(words.x)), uintBitsToFloat(unpackUint2x32(words.y))),
                     vec4(uintBitsToFloat(unpackUint2x32(words.z)), uintBitsToFloat(unpackUint2x32(words.w))));
}

u64vec4 pack_eight(EightFloats values) {
  return u64vec4(packUint2x32(floatBitsToUint(values.low.xy)), packUint2x32(floatBitsToUint(values.low.zw)),
                 packUint2x32(floatBitsToUint(values.high.xy)), packUint2x32(floatBitsToUint(values.high.zw)));
}

#endif
