// A ray in world space: origin + depth · direction for near ≤ depth ≤ far, metres; direction has unit length.
#ifndef ARAH_SHARED_RAY_H
#define ARAH_SHARED_RAY_H
#ifdef __cplusplus
namespace arah {
struct Ray {
  float origin[3];
  float near;
  float direction[3];
  float far;
};
static_assert(sizeof(Ray) == 32);
}  // namespace arah
#else
struct Ray {
  vec3 origin;
  float near;
  vec3 direction;
  float far;
};
#endif
#endif
