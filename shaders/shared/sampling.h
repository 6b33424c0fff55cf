// Push constants of shaders/sampling. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_SAMPLING_H
#define ARAH_SHARED_SAMPLING_H
#ifdef __cplusplus
#include "shaders/shared/shell_grid.h"
namespace arah::shared {
#else
#include "shared/shell_grid.h"
#endif

struct OutsideShellConstants {
  ShellGrid grid;
  float outer;  // metres
  uint rows;
};

struct ShellSamplesConstants {
  vec3 root_translation;  // metres, world
  uint rays;
  uint samples;  // of each ray
  uint jitter;   // 0: middle of the stratum
  uint seed;
  uint step_index;
  uint first_ray;  // number of ray 0 in the random sequence
};

struct SurfaceSamplesConstants {
  vec3 root_translation;
  uint rays;
  uint slots;  // samples of each ray in memory
  uint jitter;
  uint seed;
  uint step_index;
  uint first_ray;
  float half_width;     // metres
  uint around_surface;  // odd
  uint before_surface;  // >= 1
  uint without_surface;
};

struct LeastDistanceConstants {
  uint rays;
  uint samples;  // of each ray
  uint stride;   // texels of 4 floats, of the sdf
  uint column;
};

#ifdef __cplusplus
static_assert(sizeof(OutsideShellConstants) == 36);
static_assert(sizeof(LeastDistanceConstants) == 16);
static_assert(sizeof(ShellSamplesConstants) == 36);
static_assert(sizeof(SurfaceSamplesConstants) == 52);
}  // namespace arah::shared
#endif
#endif
