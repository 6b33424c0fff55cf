// One step of a damped Newton search for each row's point, whose trial was evaluated: kept where the residual fell, and the next one
//   x - (J^T J + damping)^-1 J^T g
// from the best so far (kernels/reference/damped_newton.h).
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define ROWS_CONSTANT 0
#include "lib/damped_newton.glsl"
#include "lib/finite.glsl"
#include "lib/rows.glsl"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 2, rgba32f) uniform readonly imageBuffer posed;      // by row
layout(binding = 3, rgba32f) uniform readonly imageBuffer jacobians;  // by row, three texels
layout(binding = 4, rgba32f) uniform readonly imageBuffer targets;    // by point
layout(binding = 5, scalar) restrict buffer State { DampedNewtonState state[]; };
layout(binding = 6, scalar) restrict buffer Trials { vec4 trials[]; };
layout(binding = 7, scalar) restrict writeonly buffer Canonical { vec4 canonical[]; };  // by point
layout(binding = 8, scalar) restrict buffer Counts { DampedNewtonCounts counts; };
layout(push_constant, scalar) uniform Constants { DampedNewtonConstants constants; };

shared DampedNewtonCounts own;

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const int point = point_of_row(row);
  const vec4 trial = trials[row];
  const bool searches = row < row_count(constants.row_limit) && trial.w > 0.0;
  DampedNewtonState s = state[row];
  const vec3 g = imageLoad(posed, int(row)).xyz - imageLoad(targets, point).xyz;
  vec3 j[3];
  bool finite = is_finite(g);
  for (int i = 0; i < 3; ++i) {
    j[i] = imageLoad(jacobians, 3 * int(row) + i).xyz;
    finite = finite && is_finite(j[i]);
  }
  const float size = length(g);
  const bool improves = finite && is_finite(size) && size < s.best.w;
  if (improves) {
    s.best = vec4(trial.xyz, size);
    s.residual = vec4(g, max(s.residual.w / DAMPING_FACTOR, LEAST_DAMPING));
    for (int i = 0; i < 3; ++i) s.jacobian[i] = vec4(j[i], 0.0);
  } else {
    s.residual.w *= DAMPING_FACTOR;
  }
  const bool found = s.best.w < constants.tolerance;
  const bool goes_on = !found && is_finite(s.best.w) && s.residual.w <= GREATEST_DAMPING;

  // The normal equations: a symmetric matrix by its columns, its inverse by their cross products.
  const vec3 x = s.jacobian[0].xyz, y = s.jacobian[1].xyz, z = s.jacobian[2].xyz, r = s.residual.xyz;
  const vec3 a = x.x * x + y.x * y + z.x * z + vec3(s.residual.w, 0.0, 0.0);
  const vec3 b = x.y * x + y.y * y + z.y * z + vec3(0.0, s.residual.w, 0.0);
  const vec3 c = x.z * x + y.z * y + z.z * z + vec3(0.0, 0.0, s.residual.w);
  const vec3 downhill = r.x * x + r.y * y + r.z * z;
  const vec3 bc = cross(b, c), ca = cross(c, a), ab = cross(a, b);
  const vec3 next = s.best.xyz - vec3(dot(bc, downhill), dot(ca, downhill), dot(ab, downhill)) / dot(a, bc);

  if (searches) {
    state[row] = s;
    // Where rounding leaves no inverse, the residual is asked for at the same place again and damping rises.
    trials[row] = vec4(is_finite(next) ? next : s.best.xyz, goes_on ? 1.0 : 0.0);
    if (found) canonical[point] = vec4(s.best.xyz, 1.0);
  }
  if (gl_LocalInvocationIndex == 0u) own = DampedNewtonCounts(0u, 0u, 0u);
  barrier();
  if (searches) {
    atomicAdd(own.evaluations, 1u);
    if (found) atomicAdd(own.found, 1u);
    if (goes_on) atomicAdd(own.searching, 1u);
  }
  barrier();
  if (gl_LocalInvocationIndex == 0u) {
    atomicAdd(counts.evaluations, own.evaluations);
    atomicAdd(counts.found, own.found);
    atomicAdd(counts.searching, own.searching);
  }
}
