// A direction of posed space in the axes of the canonical pose: the float32 twin of kernels/reference/color.h.
#ifndef ARAH_LIB_VIEW_DIRECTION_GLSL
#define ARAH_LIB_VIEW_DIRECTION_GLSL

// T⁻¹ v by Cramer's rule, T by row. Rotations blended until they all but cancel tell no direction: then v as it is. A
// determinant of at least 1e-3 keeps 8 |T⁻¹ v|, the highest frequency of the view encoding, where sines are exact (sine.glsl).
vec3 canonical_direction(vec3 transform[3], vec3 v) {
  const vec3 across = cross(transform[1], transform[2]);
  const float determinant = dot(transform[0], across);
  const vec3 turned = v.x * across + v.y * cross(transform[2], transform[0]) + v.z * cross(transform[0], transform[1]);
  return abs(determinant) > 1e-3 ? turned / determinant : v;
}

#endif
