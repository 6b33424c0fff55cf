// Ends a root search: one invocation writes one point's result and the workgroup adds what became of its points to the
// counts. canonical: the best iterate, w = 1 where it is a root (for rays: one within [near, far]), else 0; zeros for
// points that were never started or whose start was not finite. With INTERPOLATED, a point whose interpolated correspondence
// is valid (w > 0) has that as its result, found in no steps. Targets that are EMPTY stay so.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#define BROYDEN_CONSTANT 0
#include "lib/broyden.glsl"
layout(constant_id = 2) const bool INTERPOLATED = false;
#include "shared/empty_sample.h"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) restrict readonly buffer State { vec4 state[]; };
layout(binding = 1, rgba32f) uniform readonly imageBuffer rays;  // two texels a ray; 4 unknowns
layout(binding = 2, scalar) restrict writeonly buffer Canonical { vec4 canonical[]; };
layout(binding = 3, scalar) restrict writeonly buffer Depth { float depth[]; };  // 4 unknowns
layout(binding = 4, scalar) restrict buffer Counts { SearchCounts counts; };
layout(binding = 5, rgba32f) uniform readonly imageBuffer interpolated;
layout(binding = 6, rgba32f) uniform readonly imageBuffer targets;  // 3 unknowns
layout(push_constant, scalar) uniform Constants { BroydenFinishConstants constants; };

shared SearchCounts own;

void main() {
  const uint point = gl_GlobalInvocationID.x;
  const bool exists = point < constants.points;
  const uint at = min(point, constants.points - 1u);
  const vec4 best = state[BEST * constants.capacity + at];
  const vec4 status = state[STATUS * constants.capacity + at];
  const bool started = exists && status.z != NEVER_STARTED;
  const bool converged = started && status.z == CONVERGED;
  bool is_root = converged;
  if (UNKNOWNS == 4) {
    const float near = imageLoad(rays, 2 * int(at)).w, far = imageLoad(rays, 2 * int(at) + 1).w;
    is_root = converged && near <= best.w && best.w <= far;
  }
  const bool usable = started && is_finite(best);
  vec4 result = usable ? vec4(best.xyz, is_root ? 1.0 : 0.0) : vec4(0);
  bool given = false;
  if (INTERPOLATED) {
    const vec4 from_grid = imageLoad(interpolated, int(at));
    given = exists && from_grid.w > 0.0;
    result = given ? vec4(from_grid.xyz, 1.0) : result;
  }
  if (UNKNOWNS == 3 && exists && imageLoad(targets, int(at)).w == EMPTY) result = vec4(0.0, 0.0, 0.0, EMPTY);
  canonical[point] = result;
  if (UNKNOWNS == 4) depth[point] = usable ? best.w : 0.0;

  if (gl_LocalInvocationIndex == 0u) own = SearchCounts(0u, 0u, 0u, 0u, 0u);
  barrier();
  if (given) {
    atomicAdd(own.converged, 1u);
  } else if (started) {
    atomicAdd(own.steps, uint(status.y));
    if (converged) atomicAdd(own.converged, 1u);
    else if (status.z == DIVERGED) atomicAdd(own.diverged, 1u);
    else atomicAdd(own.exhausted, 1u);
    if (UNKNOWNS == 4 && is_root) atomicAdd(own.hits, 1u);
  }
  barrier();
  if (gl_LocalInvocationIndex == 0u) {
    atomicAdd(counts.steps, own.steps);
    atomicAdd(counts.converged, own.converged);
    atomicAdd(counts.diverged, own.diverged);
    atomicAdd(counts.exhausted, own.exhausted);
    atomicAdd(counts.hits, own.hits);
  }
}
