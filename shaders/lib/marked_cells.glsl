// What a cube's mark says (meshing/count_cells.comp): bits 0 to 7, which corners lie inside; bits 8 to 10, which of the edges from
// corner 0 along x, y and z the surface crosses: their vertices are the cube's own.
#ifndef ARAH_LIB_MARKED_CELLS_GLSL
#define ARAH_LIB_MARKED_CELLS_GLSL

#include "shared/meshing.h"

const uint CELLS_AN_INVOCATION = 32u;
const uint CELLS_A_BLOCK = 64u * CELLS_AN_INVOCATION;  // kernels/meshing/marching_cubes.h

layout(binding = 0, scalar) restrict readonly buffer Cases { uint cases[]; };  // bytes: triangles, then three edges each (cube_cases.h)

uint case_byte(uint inside, uint byte) { return cases[4u * inside + byte / 4u] >> 8u * (byte % 4u) & 255u; }
MeshCount count_of(uint mark) { return MeshCount(uint(bitCount(mark >> 8u & 7u)), case_byte(mark & 255u, 0u)); }

#endif
