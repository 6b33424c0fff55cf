// A box of nodes in posed space (world minus the root translation), metres. Valid in C++ and GLSL.
// Node (x, y, z) lies at origin + cell · (x, y, z) and is number (z · nodes.y + y) · nodes.x + x.
#ifndef ARAH_SHARED_SHELL_GRID_H
#define ARAH_SHARED_SHELL_GRID_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#endif

struct ShellGrid {
  vec3 origin;
  float cell;
  uvec3 nodes;  // along x, y, z; at least 2 each
};

#ifdef __cplusplus
static_assert(sizeof(ShellGrid) == 28 && offsetof(ShellGrid, nodes) == 16);
}  // namespace arah::shared
#endif
#endif
