// Running sums over the 64 invocations of a workgroup through shared memory, with no assumption on the subgroup size.
// Needs GL_EXT_control_flow_attributes. All invocations must call this together; it may be called again.
#ifndef ARAH_LIB_SCAN_GLSL
#define ARAH_LIB_SCAN_GLSL

shared uint scan_words[64];

// The sum of the values of the invocations before this one; `total` becomes the sum of all.
uint exclusive_scan(uint value, out uint total) {
  const uint lane = gl_LocalInvocationIndex;
  barrier();
  scan_words[lane] = value;
  barrier();
  [[unroll]] for (uint distance = 1u; distance < 64u; distance *= 2u) {
    const uint before = lane >= distance ? scan_words[lane - distance] : 0u;
    barrier();
    scan_words[lane] += before;
    barrier();
  }
  total = scan_words[63];
  return scan_words[lane] - value;
}

#endif
