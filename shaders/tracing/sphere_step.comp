// One iteration of sphere tracing (ARAH.md section 4; kernels/reference/tracing.h): one invocation moves one row's ray on
// by the sdf at its canonical point, clamped to ±max_step, and writes the next posed point. A ray whose sdf is not finite
// stays where it is and counts as diverged.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define ROWS_CONSTANT 0
#include "lib/finite.glsl"
#include "lib/rows.glsl"
#include "lib/trace_range.glsl"
#include "lib/trace_status.glsl"
#include "shared/frame.h"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 2, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 3, rgba32f) uniform readonly imageBuffer rays;  // two texels a ray: origin and near, direction and far
layout(binding = 4, scalar) restrict buffer Trace { vec4 trace[]; };
layout(binding = 5, scalar) restrict writeonly buffer Posed { vec4 posed[]; };
layout(binding = 6, scalar) restrict writeonly buffer Candidates { uint candidates[]; };
layout(binding = 7, scalar) restrict writeonly buffer Active { uint active_rows[]; };
layout(binding = 9, rgba32f) uniform readonly imageBuffer sdf;
layout(push_constant, scalar) uniform Constants { SphereConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const int ray = point_of_row(row);
  const vec4 origin_near = imageLoad(rays, 2 * ray), direction_far = imageLoad(rays, 2 * ray + 1);
  const vec4 before = trace[ray];
  const bool moves = row < row_count(constants.row_limit) && before.w == UNDER_WAY;
  const float metres_per_unit = 1.0 / frame.cube_scale;
  const float distance = metres_per_unit * imageLoad(sdf, int(row * constants.sdf_stride + constants.sdf_column)).x;

  const bool on_surface = abs(distance) <= constants.tolerance;
  const float step_length = on_surface || !is_finite(distance) ? 0.0 : clamp(distance, -constants.max_step, constants.max_step);
  const float depth = before.x + step_length;
  const bool diverged = !is_finite(distance) || depth >= trace_end(ray, origin_near.w, direction_far.w);
  const float status = diverged ? DIVERGED : on_surface ? ON_SURFACE : UNDER_WAY;
  if (moves) {
    trace[ray] = vec4(depth, distance, before.z + 1.0, status);
    posed[ray] = vec4(origin_near.xyz + depth * direction_far.xyz - frame.root_translation, 1.0);
    candidates[ray] = diverged ? 0u : 1u;
  }
  active_rows[row] = moves && status == UNDER_WAY ? 1u : 0u;
}
