// The input of a linear layer: rows of float32 in texels of four, or of halves in texels of eight. Specialised code holds one
// of the two. Rows begin at point · x_stride + x_column, in texels of their kind.
#ifndef ARAH_LIB_LINEAR_INPUT_GLSL
#define ARAH_LIB_LINEAR_INPUT_GLSL

#include "lib/half.glsl"

layout(constant_id = 7) const int X_HALF = 0;
layout(binding = 0, rgba32f) uniform readonly imageBuffer X;
layout(binding = 7, rgba32ui) uniform readonly uimageBuffer X_halves;

// Channels 8 group .. 8 group + 7 of the row.
void read_eight(int row, int group, out vec4 low, out vec4 high) {
  if (X_HALF == 0) {
    low = imageLoad(X, row + 2 * group);
    high = imageLoad(X, row + 2 * group + 1);
  } else {
    const uvec4 words = imageLoad(X_halves, row + group);
    low = unpack_halves(words.xy);
    high = unpack_halves(words.zw);
  }
}

// Channels 4 quad .. 4 quad + 3 of the row.
vec4 read_four(int row, int quad) {
  if (X_HALF == 0) return imageLoad(X, row + quad);
  const uvec4 words = imageLoad(X_halves, row + quad / 2);
  return unpack_halves((quad & 1) == 0 ? words.xy : words.zw);
}

#endif
