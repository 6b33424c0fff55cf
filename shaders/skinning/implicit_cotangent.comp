// The implicit function theorem at the roots of the correspondence search: one invocation turns one point's dL/dx into the
// cotangent on LBS(x) there, g = -J^-T dL/dx (kernels/reference/implicit.h; paper, appendix "Implicit Gradients"),
// at most 100 |dL/dx| long. 0 for points without a root and where J has no inverse; the latter are counted, and those shortened.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#include "lib/amplification.glsl"
#include "lib/finite.glsl"
#include "shared/skinning.h"

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer jacobians;  // three texels a point
layout(binding = 1, rgba32f) uniform readonly imageBuffer upstream;
layout(binding = 2, rgba32f) uniform readonly imageBuffer canonical;  // w: 1 with a root
layout(binding = 3, scalar) restrict writeonly buffer Cotangents { vec4 cotangents[]; };
layout(binding = 4, scalar) restrict buffer Counts { ImplicitCounts counts; };
layout(push_constant, scalar) uniform Constants { uint points; };

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  const vec3 x = imageLoad(jacobians, 3 * point).xyz;
  const vec3 y = imageLoad(jacobians, 3 * point + 1).xyz;
  const vec3 z = imageLoad(jacobians, 3 * point + 2).xyz;
  const vec4 upstream_x = vec4(imageLoad(upstream, point).xyz, 0.0);
  const float size = power_of_two_below(upstream_x);
  const vec4 u = upstream_x / size;
  const bool valid = uint(point) < points && imageLoad(canonical, point).w > 0.0;
  // The columns of J^-1 are these cross products over the determinant.
  const vec3 yz = cross(y, z), zx = cross(z, x), xy = cross(x, y);
  const float determinant = dot(x, yz);
  // A determinant computed in float32 carries rounding errors of some 2^-23 |x| |y| |z|: below, its sign means nothing.
  const float threshold = 4.0e-7 * length(x) * length(y) * length(z);
  const bool regular = is_finite(determinant) && abs(determinant) > threshold;
  const vec4 g = vec4(-vec3(dot(yz, u.xyz), dot(zx, u.xyz), dot(xy, u.xyz)) / determinant, 0.0);
  const float limit = amplification_limit(g, u);
  cotangents[point] = valid && regular ? size * (limit * g) : vec4(0);
  if (valid && !regular) atomicAdd(counts.singular, 1u);
  if (valid && regular && limit < 1.0) atomicAdd(counts.shortened, 1u);
}
