// Starts a damped Newton search for each row's point at starts[point]. Points that have a root, and starts that are not finite, are not
// searched.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define ROWS_CONSTANT 0
#include "lib/damped_newton.glsl"
#include "lib/finite.glsl"
#include "lib/rows.glsl"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 2, rgba32f) uniform readonly imageBuffer starts;     // by point
layout(binding = 3, rgba32f) uniform readonly imageBuffer canonical;  // by point
layout(binding = 4, scalar) restrict writeonly buffer State { DampedNewtonState state[]; };
layout(binding = 5, scalar) restrict writeonly buffer Trials { vec4 trials[]; };
layout(push_constant, scalar) uniform Constants { DampedNewtonConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const int point = point_of_row(row);
  const vec3 start = imageLoad(starts, point).xyz;
  const bool searches = row < row_count(constants.row_limit) && imageLoad(canonical, point).w == 0.0 && is_finite(start);
  DampedNewtonState fresh;
  fresh.best = vec4(start, uintBitsToFloat(0x7f800000u));
  fresh.residual = vec4(0.0, 0.0, 0.0, FIRST_DAMPING * DAMPING_FACTOR);
  for (int i = 0; i < 3; ++i) fresh.jacobian[i] = vec4(0.0);
  state[row] = fresh;
  trials[row] = vec4(is_finite(start) ? start : vec3(0.0), searches ? 1.0 : 0.0);
}
