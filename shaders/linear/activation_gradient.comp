// dA = dY ⊙ act'(stored): from the gradient at an activation's value to the gradient at its pre-activation.
// One invocation owns 8 neighbouring channels of a point. Strides and columns in texels where read, groups of 8 where written.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "lib/activation.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const int ACTIVATION = ACTIVATION_NONE;
layout(binding = 0, rgba32f) uniform readonly imageBuffer dY;
layout(binding = 1, rgba32f) uniform readonly imageBuffer stored;
layout(binding = 2, scalar) restrict writeonly buffer Result { u64vec4 result[]; };
layout(push_constant, scalar) uniform Constants {
  uint dy_stride, dy_column;
  uint stored_stride, stored_column;
  uint result_stride, result_column;
};

void main() {
  const int point = int(gl_GlobalInvocationID.x), group = int(gl_GlobalInvocationID.y);
  uvec4 words[2];
  for (int half_group = 0; half_group < 2; ++half_group) {
    const int texel = 2 * group + half_group;
    const vec4 gradient = imageLoad(dY, point * int(dy_stride) + int(dy_column) + texel);
    const vec4 value = imageLoad(stored, point * int(stored_stride) + int(stored_column) + texel);
    words[half_group] = floatBitsToUint(gradient * derivative_from_stored(ACTIVATION, value));
  }
  result[point * int(result_stride) + int(result_column) + group] =
      u64vec4(packUint2x32(words[0].xy), packUint2x32(words[0].zw), packUint2x32(words[1].xy), packUint2x32(words[1].zw));
}
