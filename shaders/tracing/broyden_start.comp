// Starts the root search of a row's point at u_0: residual g_0, H_0 and the first step -H_0 g_0 (ARAH.md section 5;
// kernels/reference/broyden.h). One invocation serves one row. H_0 is the inverse of sum_b w_b R_b at u_0 for the point
// search, of [[grad f_metric, 0], [dx_bar/dx, -v]] for the joint one. Where u_0, g_0 or H_0 is not finite (a singular
// Jacobian) there is no search, nor where the residual is below start_tolerance (0, the paper's way: a step follows always).
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
layout(binding = 3, rgba32f) uniform readonly imageBuffer starts;      // by point
layout(binding = 4, rgba32f) uniform readonly imageBuffer posed;       // by row: x_bar at the start
layout(binding = 5, rgba32f) uniform readonly imageBuffer transforms;  // by row, three texels
layout(binding = 6, rgba32f) uniform readonly imageBuffer targets;     // by point; 3 unknowns
layout(binding = 7, rgba32f) uniform readonly imageBuffer rays;        // by point, two texels; 4 unknowns, as the rest
layout(binding = 8, rgba32f) uniform readonly imageBuffer depths;      // by point, in x
layout(binding = 9, rgba32f) uniform readonly imageBuffer sdf;         // by row
layout(binding = 10, rgba32f) uniform readonly imageBuffer sdf_gradients;  // by row, per cube unit
layout(binding = 11, rgba32f) uniform readonly imageBuffer jacobians;      // by row, three texels
layout(binding = 12, scalar) restrict writeonly buffer State { vec4 state[]; };
layout(binding = 13, scalar) restrict writeonly buffer Active { uint active_rows[]; };
layout(push_constant, scalar) uniform Constants { BroydenStartConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const bool exists = row < row_count(constants.row_limit);
  const int point = point_of_row(row);
  const vec3 x_bar = imageLoad(posed, int(row)).xyz;
  vec4 transform[3];
  [[unroll]] for (int i = 0; i < 3; ++i) transform[i] = imageLoad(transforms, 3 * int(row) + i);

  vec4 u = vec4(imageLoad(starts, point).xyz, 0.0);
  vec4 g, h[4];
  if (UNKNOWNS == 3) {
    g = vec4(x_bar - imageLoad(targets, point).xyz, 0.0);
    const vec3 x = transform[0].xyz, y = transform[1].xyz, z = transform[2].xyz;
    const vec3 yz = cross(y, z);
    const mat3 inverted = mat3(yz, cross(z, x), cross(x, y)) / dot(x, yz);  // columns
    [[unroll]] for (int i = 0; i < 3; ++i) h[i] = vec4(inverted[0][i], inverted[1][i], inverted[2][i], 0.0);
    h[3] = vec4(0);
  } else {
    u.w = imageLoad(depths, point).x;
    const vec3 origin = imageLoad(rays, 2 * point).xyz, direction = imageLoad(rays, 2 * point + 1).xyz;
    const float f = imageLoad(sdf, int(row * constants.sdf_stride + constants.sdf_column)).x / frame.cube_scale;
    g = vec4(f, x_bar - (origin + u.w * direction - frame.root_translation));
    // d f_metric / dx = df/dn: the factor from cube units to metres and dn/dx cancel.
    const vec3 gradient = imageLoad(sdf_gradients, int(row * constants.gradient_stride + constants.gradient_column)).xyz;
    mat4 transposed = mat4(vec4(gradient, 0.0), vec4(0), vec4(0), vec4(0));
    [[unroll]] for (int i = 0; i < 3; ++i) transposed[i + 1] = vec4(imageLoad(jacobians, 3 * int(row) + i).xyz, -direction[i]);
    const mat4 inverted = inverse(transposed);  // its columns are the rows of the inverse
    [[unroll]] for (int i = 0; i < 4; ++i) h[i] = inverted[i];
  }

  const vec4 first_step = -times(h, g);
  const float size = length(g);
  bool searches = is_finite(u) && is_finite(size);
  [[unroll]] for (int i = 0; i < UNKNOWNS; ++i) searches = searches && is_finite(h[i]);
  const bool is_root = searches && size < constants.start_tolerance;
  const bool runs = searches && !is_root && constants.max_iterations > 0u;
  if (exists) {
    const uint capacity = constants.capacity, at = uint(point);
    state[ITERATE * capacity + at] = u + first_step;
    state[STEP * capacity + at] = first_step;
    state[RESIDUAL * capacity + at] = g;
    state[BEST * capacity + at] = u;
    state[STATUS * capacity + at] = vec4(size, 0.0, runs ? ACTIVE : is_root ? CONVERGED : searches ? EXHAUSTED : DIVERGED, 0.0);
    [[unroll]] for (int i = 0; i < UNKNOWNS; ++i) state[(INVERSE + i) * capacity + at] = h[i];
    if (KEEP_TRANSFORMS) {
      [[unroll]] for (int i = 0; i < 3; ++i) state[PLANES * capacity + 3 * at + i] = transform[i];
    }
  }
  active_rows[row] = exists && runs ? 1u : 0u;
}
