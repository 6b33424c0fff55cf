// Sine and cosine of the same angles, in radians: |error| ≤ 2e-7 for |x| ≤ 1e4 (float32's own rounding of values near 1 is
// 0.6e-7), growing with |x| beyond; NaN for NaN and infinities. Vulkan's own sin and cos promise 2^-11 and no range.
// x = kπ + r with |r| ≤ π/2, so that sin x = (−1)^k sin r and cos x = (−1)^k cos r.
#ifndef ARAH_LIB_SINE_GLSL
#define ARAH_LIB_SINE_GLSL

vec4 sine(vec4 x, out vec4 cosine) {
  // Cody and Waite: π in parts of 12, 12 and 24 bits. k has at most 12 bits up to 1e4, so that k times the first two parts
  // is exact, and so are the differences; `precise` keeps the order that this rests on.
  const vec4 k = roundEven(x * 0.318309886);
  precise vec4 r = x - k * 3.140625;
  r = r - k * 0.000967502594;
  r = r - k * 1.50995803e-7;
  // Minimax polynomials on [−π/2, π/2] (Remez), errors 4.6e-9 and 2.4e-10 before rounding.
  const vec4 s = r * r;
  const vec4 odd = r + r * s * (-0.166666567 + s * (0.00833301619 + s * (-0.000198065478 + s * 2.59990315e-6)));
  const vec4 even = 1.0 + s * (-0.5 + s * (0.0416666418 + s * (-0.00138884026 + s * (2.47618082e-5 + s * -2.60756622e-7))));
  const uvec4 sign = uvec4(ivec4(k)) << 31;
  cosine = uintBitsToFloat(floatBitsToUint(even) ^ sign);
  return uintBitsToFloat(floatBitsToUint(odd) ^ sign);
}

#endif
