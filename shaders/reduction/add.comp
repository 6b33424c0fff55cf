// y += x, eight numbers an invocation.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "lib/eight_floats.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { uint eights; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer x;
layout(binding = 1, scalar) buffer Y { u64vec4 y[]; };

void main() {
  uint at = min(gl_GlobalInvocationID.x, eights - 1u);
  EightFloats sum = unpack_eight(y[at]);
  sum.low += imageLoad(x, 2 * int(at));
  sum.high += imageLoad(x, 2 * int(at) + 1);
  if (gl_GlobalInvocationID.x < eights) y[at] = pack_eight(sum);
}
