// Where the template's weights skin, the start that the nearest vertex gives is the correspondence itself. One invocation
// serves one point: the start of a wanted point (target.w > 0) with w = 1, zeros for all others and where a start is not
// finite (a blend of transforms without an inverse). Targets that are EMPTY stay so.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#include "lib/finite.glsl"
#include "shared/empty_sample.h"

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer targets;
layout(binding = 1, rgba32f) uniform readonly imageBuffer starts;
layout(binding = 2, scalar) restrict writeonly buffer Canonical { vec4 canonical[]; };

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  const vec3 start = imageLoad(starts, point).xyz;
  const float wanted = imageLoad(targets, point).w;
  canonical[point] = wanted > 0.0 && is_finite(start) ? vec4(start, 1.0) : vec4(0.0, 0.0, 0.0, wanted == EMPTY ? EMPTY : 0.0);
}
