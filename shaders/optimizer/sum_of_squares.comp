// First level of a gradient's 2-norm. One workgroup adds the squares of squares_tile numbers in a fixed order and
// counts those that are NaN or infinite; it leaves one SquaresPartial.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/workgroup_sum.glsl"
#include "shared/optimizer.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { SumOfSquaresConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer gradients;
layout(binding = 1, scalar) writeonly buffer Partials { SquaresPartial partials[]; };

// Per component 1 where NaN or infinite: by the exponent's bits, which no fast-math assumption optimises away.
vec4 nonfinite(vec4 values) {
  uvec4 bits = floatBitsToUint(values) & 0x7f800000u;
  return mix(vec4(0.0), vec4(1.0), equal(bits, uvec4(0x7f800000u)));
}

void main() {
  int texels = int(c.texels);
  int first = int(gl_WorkGroupID.x * (squares_tile / 4u) + gl_LocalInvocationIndex);
  vec4 squares = vec4(0.0);
  vec4 bad = vec4(0.0);
  for (int k = 0; k < int(squares_tile / 256u); ++k) {
    int at = first + 64 * k;
    vec4 g = imageLoad(gradients, min(at, texels - 1));
    g = at < texels ? g : vec4(0.0);
    squares += g * g;
    bad += nonfinite(g);
  }
  vec2 sums = workgroup_sum(vec2(dot(squares, vec4(1.0)), dot(bad, vec4(1.0))));
  if (gl_LocalInvocationIndex == 0u) partials[c.first_partial + gl_WorkGroupID.x] = SquaresPartial(sums.x, uint(sums.y));
}
