// One step of Broyden's "good" method (ARAH.md section 5; kernels/reference/broyden.h) for one row's point, whose residual
// was evaluated at its iterate: the best iterate is kept, H updated and the next iterate written. Points that are not
// active any more are left as they are.
//   y = g - g_old;  v^T = s^T H;  H += ((s - H y) / (v^T y ± offset)) v^T;  next step = -H g
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#define ROWS_CONSTANT 0
#define BROYDEN_CONSTANT 2
#include "lib/broyden.glsl"
#include "lib/rows.glsl"
#include "shared/frame.h"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 2, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 3, rgba32f) uniform readonly imageBuffer posed;       // by row: x_bar at the iterate
layout(binding = 4, rgba32f) uniform readonly imageBuffer transforms;  // by row, three texels; with KEEP_TRANSFORMS
layout(binding = 5, rgba32f) uniform readonly imageBuffer targets;     // by point; 3 unknowns
layout(binding = 6, rgba32f) uniform readonly imageBuffer rays;        // by point, two texels; 4 unknowns
layout(binding = 7, rgba32f) uniform readonly imageBuffer sdf;         // by row; 4 unknowns
layout(binding = 8, scalar) restrict buffer State { vec4 state[]; };
layout(binding = 9, scalar) restrict writeonly buffer Active { uint active_rows[]; };
layout(push_constant, scalar) uniform Constants { BroydenStepConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const int point = point_of_row(row);
  const uint capacity = constants.capacity, at = uint(point);
  const vec4 u = state[ITERATE * capacity + at];
  const vec4 last_step = state[STEP * capacity + at];
  const vec4 g_old = state[RESIDUAL * capacity + at];
  vec4 status = state[STATUS * capacity + at];
  vec4 h[4];
  h[3] = vec4(0);
  [[unroll]] for (int i = 0; i < UNKNOWNS; ++i) h[i] = state[(INVERSE + i) * capacity + at];
  const bool searches = row < row_count(constants.row_limit) && status.z == ACTIVE;

  const vec3 x_bar = imageLoad(posed, int(row)).xyz;
  vec4 g;
  if (UNKNOWNS == 3) {
    g = vec4(x_bar - imageLoad(targets, point).xyz, 0.0);
  } else {
    const vec3 origin = imageLoad(rays, 2 * point).xyz, direction = imageLoad(rays, 2 * point + 1).xyz;
    const float f = imageLoad(sdf, int(row * constants.sdf_stride + constants.sdf_column)).x / frame.cube_scale;
    g = vec4(f, x_bar - (origin + u.w * direction - frame.root_translation));
  }
  const float size = length(g);
  const bool finite = is_finite(size);
  const bool improves = finite && size < status.x;
  const bool far_off = !finite || size >= constants.divergence;
  if (improves) status.x = size;
  status.y += 1.0;
  const bool found = status.x <= constants.tolerance;
  const bool spent = status.y >= float(constants.max_iterations);
  const bool goes_on = !found && !far_off && !spent;
  // The search ends at a residual of exactly the tolerance, but does not count as converged.
  status.z = goes_on ? ACTIVE : status.x < constants.tolerance ? CONVERGED : far_off ? DIVERGED : EXHAUSTED;

  const vec4 y = g - g_old;
  vec4 v = vec4(0);
  [[unroll]] for (int i = 0; i < UNKNOWNS; ++i) v += last_step[i] * h[i];
  float denominator = dot(v, y);
  denominator += denominator < 0.0 ? -constants.denominator_offset : constants.denominator_offset;
  const vec4 factors = (last_step - times(h, y)) / denominator;
  [[unroll]] for (int i = 0; i < UNKNOWNS; ++i) h[i] += factors[i] * v;
  const vec4 next_step = -times(h, g);

  if (searches) {
    state[STATUS * capacity + at] = status;
    if (improves) {
      state[BEST * capacity + at] = u;
      if (KEEP_TRANSFORMS) {
        [[unroll]] for (int i = 0; i < 3; ++i)
          state[PLANES * capacity + 3 * at + i] = imageLoad(transforms, 3 * int(row) + i);
      }
    }
    if (goes_on) {
      state[ITERATE * capacity + at] = u + next_step;
      state[STEP * capacity + at] = next_step;
      state[RESIDUAL * capacity + at] = g;
      [[unroll]] for (int i = 0; i < UNKNOWNS; ++i) state[(INVERSE + i) * capacity + at] = h[i];
    }
  }
  active_rows[row] = searches && goes_on ? 1u : 0u;
}
