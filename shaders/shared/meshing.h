// Push constants and results of shaders/meshing. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_MESHING_H
#define ARAH_SHARED_MESHING_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#endif

struct MeshingConstants {
  uint cells;
};

// Of one cube, of a block of cubes, or where a cube's own begin.
struct MeshCount {
  uint vertices;
  uint triangles;
};

#ifdef __cplusplus
}  // namespace arah::shared
#endif
#endif
