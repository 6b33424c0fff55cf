// Canonical points of posed ones by the inverse of their blended transforms, x = T⁻¹ x_bar (kernels/reference/lbs.h): one
// invocation serves one point. w = 1 where x_bar is wanted and T has an inverse in float32, else all zeros.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#include "lib/finite.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer targets;     // w > 0: wanted
layout(binding = 1, rgba32f) uniform readonly imageBuffer transforms;  // three texels a point, by row
layout(binding = 2, scalar) restrict writeonly buffer Canonical { vec4 canonical[]; };
layout(push_constant, scalar) uniform Constants { uint points; };

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  const vec4 target = imageLoad(targets, point);
  const vec4 x = imageLoad(transforms, 3 * point);
  const vec4 y = imageLoad(transforms, 3 * point + 1);
  const vec4 z = imageLoad(transforms, 3 * point + 2);
  const vec3 d = target.xyz - vec3(x.w, y.w, z.w);
  const vec3 yz = cross(y.xyz, z.xyz);
  const float determinant = dot(x.xyz, yz);
  // As in implicit_cotangent: below, rounding makes up the determinant.
  const float threshold = 4.0e-7 * length(x.xyz) * length(y.xyz) * length(z.xyz);
  const vec3 result = (d.x * yz + d.y * cross(z.xyz, x.xyz) + d.z * cross(x.xyz, y.xyz)) / determinant;
  const bool found = uint(point) < points && target.w > 0.0 && abs(determinant) > threshold && is_finite(result);
  canonical[point] = found ? vec4(result, 1) : vec4(0);
}
