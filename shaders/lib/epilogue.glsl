// What happens to the products of a linear layer before they are stored; shared by both families of kernels.
// MODE_ACTIVATION  y = act(a);                               second (sine): cos(a)
// MODE_GRADIENT    r = a + before;  y = r ⊙ act'(stored) + after;   second: r
// MODE_TANGENT     y = a ⊙ act'(stored);                     second: −before ⊙ a ⊙ after
//   (sine layers: before = h = sin φ, after = ∂f/∂h, a = φ̇, so second = −sin φ · φ̇ · ∂f/∂h: the term of the second-order
//    backward pass that goes through the curvature of the sine)
// The result is stored as float32 or, with RESULT_HALF, as halves; all else is float32.
#ifndef ARAH_LIB_EPILOGUE_GLSL
#define ARAH_LIB_EPILOGUE_GLSL

#include "lib/activation.glsl"
#include "lib/half.glsl"

const int MODE_ACTIVATION = 0, MODE_GRADIENT = 1, MODE_TANGENT = 2;

layout(constant_id = 2) const int MODE = MODE_ACTIVATION;
layout(constant_id = 3) const int ACTIVATION = ACTIVATION_NONE;
layout(constant_id = 4) const int HAS_SECOND = 0;
layout(constant_id = 5) const int HAS_BEFORE = 0;
layout(constant_id = 6) const int HAS_AFTER = 0;
layout(constant_id = 8) const int RESULT_HALF = 0;

layout(binding = 1, scalar) restrict writeonly buffer Result { u64vec4 result[]; };
layout(binding = 2, scalar) restrict writeonly buffer Second { u64vec4 second_result[]; };
layout(binding = 3, rgba32f) uniform readonly imageBuffer stored;
layout(binding = 4, rgba32f) uniform readonly imageBuffer before;
layout(binding = 5, rgba32f) uniform readonly imageBuffer after;
layout(binding = 6, scalar) restrict writeonly buffer HalfResult { uvec4 half_result[]; };

// Strides and columns in texels of 4 floats (of 8 halves: linear_input.glsl) where read, in groups of 8 numbers where written.
layout(push_constant, scalar) uniform Constants {
  uint64_t weights;
  uint x_stride, x_column;
  uint result_stride, result_column;
  uint second_stride, second_column;
  uint stored_stride, stored_column;
  uint before_stride, before_column;
  uint after_stride, after_column;
  uint outputs;
  uint inputs;  // read by the shuffled kernel
};

u64vec4 packed(vec4 low, vec4 high) {
  const uvec4 l = floatBitsToUint(low), h = floatBitsToUint(high);
  return u64vec4(packUint2x32(l.xy), packUint2x32(l.zw), packUint2x32(h.xy), packUint2x32(h.zw));
}

vec4 finish(int point, int texel, vec4 a, out vec4 second) {
  second = vec4(0);
  if (MODE == MODE_ACTIVATION) return activate(ACTIVATION, a, second);
  vec4 derivative = vec4(1);
  if (ACTIVATION != ACTIVATION_NONE)
    derivative = derivative_from_stored(ACTIVATION, imageLoad(stored, point * int(stored_stride) + int(stored_column) + texel));
  vec4 b = vec4(0), e = vec4(0);
  if (HAS_BEFORE != 0) b = imageLoad(before, point * int(before_stride) + int(before_column) + texel);
  if (HAS_AFTER != 0) e = imageLoad(after, point * int(after_stride) + int(after_column) + texel);
  if (MODE == MODE_TANGENT) {
    second = -b * a * e;
    return a * derivative;
  }
  second = a + b;
  return second * derivative + e;
}

// Stores 8 neighbouring outputs of a point; group counts groups of 8 outputs.
void store_group(int point, int group, vec4 low, vec4 high) {
  vec4 second_low, second_high;
  const vec4 y_low = finish(point, 2 * group, low, second_low);
  const vec4 y_high = finish(point, 2 * group + 1, high, second_high);
  const int at = point * int(result_stride) + int(result_column) + group;
  if (RESULT_HALF == 0) result[at] = packed(y_low, y_high);
  else half_result[at] = pack_halves(y_low, y_high);
  if (HAS_SECOND != 0) second_result[point * int(second_stride) + int(second_column) + group] = packed(second_low, second_high);
}

#endif
