// The implicit function theorem at the roots u = (x, d) of the joint search: one invocation turns one ray's dL/du into the
// cotangents on f_metric(x) and LBS(x) there, (sdf, skinned) = -J^-T dL/du with J = [[grad f_metric, 0], [dLBS/dx, -v]]
// (kernels/reference/implicit.h; paper, appendix "Implicit Gradients"), at most 100 |dL/du| long. 0 for rays without a root and where J has no
// inverse (a ray that grazes the surface); the latter are counted, and those shortened. All but the rays is by row; BY_ROW: so are these.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#include "lib/amplification.glsl"
#include "lib/finite.glsl"
#include "shared/frame.h"
#include "shared/skinning.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint BY_ROW = 1u;  // 0: row r is of ray `of_row[r]`
layout(binding = 0, rgba32f) uniform readonly imageBuffer jacobians;      // three texels a ray
layout(binding = 1, rgba32f) uniform readonly imageBuffer sdf_gradients;  // df/dn per cube unit = df_metric/dx
layout(binding = 2, rgba32f) uniform readonly imageBuffer rays;           // two texels a ray; the second: direction
layout(binding = 3, rgba32f) uniform readonly imageBuffer upstream;       // dL/dx, dL/dd
layout(binding = 4, rgba32f) uniform readonly imageBuffer canonical;      // w: 1 with a root
layout(binding = 5, scalar) restrict writeonly buffer Cotangents { vec4 cotangents[]; };
layout(binding = 6, scalar) restrict writeonly buffer SdfCotangents { vec4 sdf_cotangents[]; };
layout(binding = 7, scalar) restrict buffer Counts { ImplicitCounts counts; };
layout(binding = 8, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 9, scalar) restrict readonly buffer OfRow { uint of_row[]; };
layout(push_constant, scalar) uniform Constants { ImplicitJointConstants constants; };

void main() {
  const int ray = int(gl_GlobalInvocationID.x);
  const int in_list = BY_ROW != 0u ? ray : int(of_row[ray]);
  const vec3 direction = imageLoad(rays, 2 * in_list + 1).xyz;
  const vec3 normal = imageLoad(sdf_gradients, ray * int(constants.gradient_stride) + int(constants.gradient_column)).xyz;
  mat4 transposed;  // its columns are the rows of J
  transposed[0] = vec4(normal, 0.0);
  [[unroll]] for (int i = 0; i < 3; ++i) transposed[i + 1] = vec4(imageLoad(jacobians, 3 * ray + i).xyz, -direction[i]);
  const vec4 upstream_xd = imageLoad(upstream, ray);
  const float size = power_of_two_below(upstream_xd);
  const vec4 u = upstream_xd / size;
  const bool valid = uint(ray) < constants.rays && imageLoad(canonical, ray).w > 0.0;

  // A determinant computed in float32 carries rounding errors of some 2^-23 times the rows' lengths: below, its sign means
  // nothing.
  const float determinant = determinant(transposed);
  float threshold = 1.0e-6;
  [[unroll]] for (int i = 0; i < 4; ++i) threshold *= length(transposed[i]);
  const bool regular = is_finite(determinant) && abs(determinant) > threshold;
  vec4 g = -(inverse(transposed) * u);
  const float limit = amplification_limit(g, u);
  g = size * (limit * g);
  const bool found = valid && regular;
  cotangents[ray] = found ? vec4(g.yzw, 0.0) : vec4(0);
  // f_metric = f / cube_scale: the network's own value is in cube units.
  const uint at = uint(ray) * constants.sdf_stride + constants.sdf_column;
  sdf_cotangents[at] = vec4(found ? g.x / frame.cube_scale : 0.0, 0.0, 0.0, 0.0);
  if (valid && !regular) atomicAdd(counts.singular, 1u);
  if (found && limit < 1.0) atomicAdd(counts.shortened, 1u);
}
