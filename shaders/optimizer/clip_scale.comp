// Second level of a gradient's 2-norm, and the factor that clips it. One workgroup adds all partials in a fixed order
// and writes the group's GradientNorm.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/workgroup_sum.glsl"
#include "shared/optimizer.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { ClipScaleConstants c; };
layout(binding = 0, scalar) readonly buffer Partials { SquaresPartial partials[]; };
layout(binding = 1, scalar) writeonly buffer Norms { GradientNorm norms[]; };

shared uint nonfinite_of_lane[64];

void main() {
  uint lane = gl_LocalInvocationIndex;
  float squares = 0.0;
  uint nonfinite = 0u;
  for (uint i = lane; i < c.partials; i += 64u) {
    squares += partials[i].squares;
    nonfinite += partials[i].nonfinite;
  }
  nonfinite_of_lane[lane] = nonfinite;
  float norm = sqrt(workgroup_sum(squares));  // its barriers also publish nonfinite_of_lane
  if (lane == 0u) {
    uint all = 0u;
    for (uint i = 0u; i < 64u; ++i) all += nonfinite_of_lane[i];
    bool usable = (floatBitsToUint(norm) & 0x7f800000u) != 0x7f800000u;
    float scale = c.max_norm > 0.0 && norm > c.max_norm ? c.max_norm / norm : 1.0;
    norms[c.norm_index] = GradientNorm(norm, usable ? scale : 0.0, all, usable ? 1u : 0u);
  }
}
