// Counter-based random numbers: a pure function of (seed, step, ray, dimension), so that the order of execution is
// irrelevant and a resumed run repeats. Exactly the integers of kernels/reference/random.h.
// Source: pcg4d of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
#ifndef ARAH_LIB_RANDOM_GLSL
#define ARAH_LIB_RANDOM_GLSL

// 4 x 32 random bits of a 4 x 32 bit key; all arithmetic modulo 2^32.
uvec4 random_bits(uvec4 key) {
  uvec4 v = key * 1664525u + 1013904223u;
  v.x += v.y * v.w;
  v.y += v.z * v.x;
  v.z += v.x * v.y;
  v.w += v.y * v.z;
  v ^= v >> 16u;
  v.x += v.y * v.w;
  v.y += v.z * v.x;
  v.z += v.x * v.y;
  v.w += v.y * v.z;
  return v;
}

// Uniform in [0, 1): the 24 high bits of the first word times 2^-24, exact in float32.
float random_unit(uint seed, uint step_index, uint ray, uint dimension) {
  return float(random_bits(uvec4(seed, step_index, ray, dimension)).x >> 8u) * (1.0 / 16777216.0);
}

#endif
