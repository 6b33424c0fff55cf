// dL/dlogits of lib/hierarchical_softmax.glsl in the words that rows are stored by.
#ifndef ARAH_LIB_STORE_LOGITS_GLSL
#define ARAH_LIB_STORE_LOGITS_GLSL

#include "lib/eight_floats.glsl"

// Eight of them, zeros for a row that does not exist.
u64vec4 logit_group(int group, bool exists) {
  const int first = 8 * group;
  const vec4 low = vec4(d_logits[first], d_logits[first + 1], d_logits[first + 2], d_logits[first + 3]);
  const vec4 high = vec4(d_logits[first + 4], d_logits[first + 5], d_logits[first + 6], d_logits[first + 7]);
  return exists ? pack_eight(EightFloats(low, high)) : u64vec4(0);
}

#endif
