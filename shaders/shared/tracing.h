// Push constants and counters of shaders/tracing. Valid in C++ and GLSL. Texels are 4 floats, groups 8.
#ifndef ARAH_SHARED_TRACING_H
#define ARAH_SHARED_TRACING_H
#ifdef __cplusplus
#include "shaders/shared/shell_grid.h"
namespace arah::shared {
#else
#include "shared/shell_grid.h"
#endif

struct NearestVertexConstants {
  uint row_limit;
  vec3 origin;  // of the grid, posed space, metres
  float cell_size;
  uvec3 cells;  // along each axis
};

struct BoneStartConstants {
  uint row_limit;
  uint rank;  // 0: of the nearest bone
};

struct KeepRootConstants {
  uint row_limit;
  uint sdf_stride;  // texels
  uint sdf_column;
};

struct InterpolateConstants {
  uint points;
  vec3 origin;  // of the grid's first node, posed space, metres
  float cell;   // metres between nodes
  uvec3 nodes;  // along each axis
  float longest;  // metres between the canonical points of two neighbouring nodes, at most
};

struct InterpolateDistancesConstants {
  ShellGrid grid;  // in canonical space
  uint rows;
};

struct NormaliseInputsConstants {
  uint row_limit;
  uint stride;  // groups
  uint column;
};

struct CompactConstants {
  uint row_limit;
};

struct SphereConstants {
  uint row_limit;
  uint sdf_stride;  // texels
  uint sdf_column;
  float max_step;   // metres
  float tolerance;  // metres
};

struct BroydenStartConstants {
  uint row_limit;
  uint capacity;    // points of the state
  uint sdf_stride;  // texels
  uint sdf_column;
  uint gradient_stride;  // texels
  uint gradient_column;
  uint max_iterations;
  float start_tolerance;  // metres: a start whose residual is below is a root
};

struct BroydenStepConstants {
  uint row_limit;
  uint capacity;    // points of the state
  uint sdf_stride;  // texels
  uint sdf_column;
  uint max_iterations;
  float tolerance;           // metres
  float divergence;          // metres
  float denominator_offset;
};

struct BroydenFinishConstants {
  uint points;
  uint capacity;
};

struct DampedNewtonConstants {
  uint row_limit;
  float tolerance;  // metres
};

// Of damped Newton searches; added to by each step.
struct DampedNewtonCounts {
  uint evaluations;  // of points
  uint found;        // points
  uint searching;    // points whose search goes on
};

// What became of the points of a root search; added to by each.
struct SearchCounts {
  uint steps;      // taken by all points together
  uint converged;  // residual below the tolerance
  uint diverged;   // residual above the limit, or a value that is not finite
  uint exhausted;  // out of iterations
  uint hits;       // rays that converged within [near, far]; of joint searches alone
};

#ifdef __cplusplus
static_assert(sizeof(NearestVertexConstants) == 32);
static_assert(sizeof(BoneStartConstants) == 8);
static_assert(sizeof(KeepRootConstants) == 12);
static_assert(sizeof(InterpolateConstants) == 36);
static_assert(sizeof(InterpolateDistancesConstants) == 32);
static_assert(sizeof(NormaliseInputsConstants) == 12);
static_assert(sizeof(SphereConstants) == 20);
static_assert(sizeof(BroydenStartConstants) == 32);
static_assert(sizeof(BroydenStepConstants) == 32);
static_assert(sizeof(SearchCounts) == 20);
}  // namespace arah::shared
#endif
#endif
