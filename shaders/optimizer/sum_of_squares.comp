// First level of a gradient's 2-norm. One workgroup adds the squares of squares_tile numbers in a fixed order and
// counts those that are NaN or infinite; it leaves one SquaresPartial.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "lib/eight_floats.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/optimizer.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { SumOfSquaresConstants c; };
layout(binding = 0, scalar) readonly buffer Gradients { u64vec4 gradients[]; };
layout(binding = 1, scalar) writeonly buffer Partials { SquaresPartial partials[]; };

// Per component 1 where NaN or infinite: by the exponent's bits, which no fast-math assumption optimises away.
vec4 nonfinite(vec4 values) {
  uvec4 bits = floatBitsToUint(values) & 0x7f800000u;
  return mix(vec4(0.0), vec4(1.0), equal(bits, uvec4(0x7f800000u)));
}

void main() {
  uint eights = c.eights;
  uint first = gl_WorkGroupID.x * (squares_tile / 8u) + gl_LocalInvocationIndex;
  vec4 squares = vec4(0.0);
  vec4 bad = vec4(0.0);
  for (uint k = 0u; k < squares_tile / 512u; ++k) {
    uint at = first + 64u * k;
    EightFloats g = unpack_eight(gradients[min(at, eights - 1u)]);
    vec4 own = at < eights ? vec4(1.0) : vec4(0.0);
    squares += at < eights ? g.low * g.low + g.high * g.high : vec4(0.0);
    bad += own * (nonfinite(g.low) + nonfinite(g.high));
  }
  vec2 sums = workgroup_sum(vec2(dot(squares, vec4(1.0)), dot(bad, vec4(1.0))));
  if (gl_LocalInvocationIndex == 0u) partials[c.first_partial + gl_WorkGroupID.x] = SquaresPartial(sums.x, uint(sums.y));
}
