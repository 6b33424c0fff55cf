// Starts sphere tracing: one invocation puts one row's ray where it begins to be followed and writes the posed point there.
// trace: depth, sdf at the last evaluated point, evaluations, status (lib/trace_status.glsl).
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define ROWS_CONSTANT 0
#include "lib/rows.glsl"
#include "lib/trace_range.glsl"
#include "lib/trace_status.glsl"
#include "shared/frame.h"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 2, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 3, rgba32f) uniform readonly imageBuffer rays;  // two texels a ray: origin and near, direction and far
layout(binding = 4, scalar) restrict writeonly buffer Trace { vec4 trace[]; };
layout(binding = 5, scalar) restrict writeonly buffer Posed { vec4 posed[]; };
layout(binding = 6, scalar) restrict writeonly buffer Candidates { uint candidates[]; };
layout(binding = 7, scalar) restrict writeonly buffer Active { uint active_rows[]; };
layout(push_constant, scalar) uniform Constants { SphereConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const bool exists = row < row_count(constants.row_limit);
  const int ray = point_of_row(row);
  const vec4 origin_near = imageLoad(rays, 2 * ray), direction_far = imageLoad(rays, 2 * ray + 1);
  const float depth = trace_begin(ray, origin_near.w, direction_far.w);
  const bool inside = depth < trace_end(ray, origin_near.w, direction_far.w);
  if (exists) {
    trace[ray] = vec4(depth, 0.0, 0.0, inside ? UNDER_WAY : DIVERGED);
    posed[ray] = vec4(origin_near.xyz + depth * direction_far.xyz - frame.root_translation, 1.0);
    candidates[ray] = inside ? 1u : 0u;
  }
  active_rows[row] = exists && inside ? 1u : 0u;
}
