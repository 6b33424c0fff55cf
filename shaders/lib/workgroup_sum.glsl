// Sum over a workgroup of 64 in a fixed order, whatever the subgroup size. Every invocation must call it.
#ifndef ARAH_LIB_WORKGROUP_SUM_GLSL
#define ARAH_LIB_WORKGROUP_SUM_GLSL

shared vec2 workgroup_values[64];

// The sums reach every invocation. May be called again.
vec2 workgroup_sum(vec2 value) {
  uint lane = gl_LocalInvocationIndex;
  barrier();
  workgroup_values[lane] = value;
  barrier();
  for (uint width = 32u; width > 0u; width >>= 1u) {
    if (lane < width) workgroup_values[lane] += workgroup_values[lane + width];
    barrier();
  }
  return workgroup_values[0];
}

float workgroup_sum(float value) { return workgroup_sum(vec2(value, 0.0)).x; }

#endif
