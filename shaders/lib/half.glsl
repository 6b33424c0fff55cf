// Sixteen-bit floats (11 bits of significand, up to 65,504), eight in a texel of four words: how hidden activations are kept
// where the arithmetic asks for it (docs/decisions/arithmetic.md). The device needs no 16-bit feature.
#ifndef ARAH_LIB_HALF_GLSL
#define ARAH_LIB_HALF_GLSL

// In the low 16 bits the nearest half, ties to even, and none beyond 65,504; NaN and infinities stay what they are.
// Vulkan leaves packHalf2x16's rounding to the device, and a CPU device cuts off: twice the error, all of it towards zero. The
// integers are the same everywhere, and there a quarter of its time.
uvec4 half_bits(vec4 x) {
  const uvec4 bits = floatBitsToUint(x);
  const uvec4 size = bits & 0x7fffffffu;
  // 13 bits less of significand, rounded; exponents count from 15 instead of 127.
  const uvec4 normal = ((size + 0xfffu + ((size >> 13) & 1u)) >> 13) - ((127u - 15u) << 10);
  // Below 2^-14 halves are 2^-24 apart, and so are float32s from a half to one: the sum is what rounds.
  const uvec4 small = floatBitsToUint(abs(x) + 0.5) - floatBitsToUint(0.5);
  uvec4 half_size = min(mix(normal, small, lessThan(size, uvec4(0x38800000u))), uvec4(0x7bffu));
  half_size = mix(half_size, uvec4(0x7c00u), greaterThanEqual(size, uvec4(0x7f800000u)));
  half_size = mix(half_size, uvec4(0x7e00u), greaterThan(size, uvec4(0x7f800000u)));
  return half_size | ((bits >> 16) & 0x8000u);
}

uvec4 pack_halves(vec4 low, vec4 high) {
  const uvec4 l = half_bits(low), h = half_bits(high);
  return uvec4(l.x | l.y << 16, l.z | l.w << 16, h.x | h.y << 16, h.z | h.w << 16);
}

// A device may take those below 2^-14 for 0.
vec4 unpack_halves(uvec2 words) { return vec4(unpackHalf2x16(words.x), unpackHalf2x16(words.y)); }

#endif
