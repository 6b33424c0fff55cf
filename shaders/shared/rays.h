// Push constants of shaders/rays. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_RAYS_H
#define ARAH_SHARED_RAYS_H
#ifdef __cplusplus
#include "shaders/shared/shell_grid.h"
namespace arah::shared {
#else
#include "shared/shell_grid.h"
#endif

struct GenerateConstants {
  vec3 rotation_rows[3];  // world → camera
  vec3 origin;            // camera centre, world metres
  float fx, fy, cx, cy;   // pixels
  vec3 box_minimum;       // world metres
  vec3 box_maximum;
  uvec2 corner;  // rectangle: its first pixel
  uint width;    // rectangle: pixels in a row
  uint count;    // rays
};

struct ShellBinsConstants {
  ShellGrid grid;
  vec3 root_translation;  // metres, world
  float outer;            // metres: bins farther outside are dropped
  float inner;            // metres: the first bin deeper inside is the last
  uint count;             // rays
};

#ifdef __cplusplus
static_assert(sizeof(GenerateConstants) == 104 && offsetof(GenerateConstants, box_minimum) == 64);
static_assert(sizeof(ShellBinsConstants) == 52 && offsetof(ShellBinsConstants, outer) == 40);
}  // namespace arah::shared
#endif
#endif
