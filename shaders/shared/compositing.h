// Push constants of shaders/compositing. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_COMPOSITING_H
#define ARAH_SHARED_COMPOSITING_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#endif

// How samples get their colours: see shaders/compositing/forward.comp.
const uint SHADING_BY_ROW = 0u;
const uint SHADING_BY_SLOT = 1u;
const uint SHADING_SELECTS = 2u;
const uint SHADING_BY_GROUP = 3u;
const uint NO_SLOT = 0xffffffffu;

// What the density is of: see shaders/lib/density.glsl.
const uint DENSITY_LAPLACE = 0u;
const uint DENSITY_SOFTPLUS = 1u;

struct CompositeConstants {
  uint rays;
  uint samples;     // of each ray
  uint sdf_stride;  // floats, multiples of 4, as the three below
  uint sdf_column;
  uint rgb_stride;
  uint rgb_column;
  uint scale_index;       // of b's free parameter among the parameters
  float metres_per_unit;  // of the sdf network
  float last_delta;       // metres
  float least_weight;     // of a sample that is flagged to be shaded: more than this
};

struct GroupSamplesConstants {
  uint rays;
  uint samples;  // of each ray
  uint groups;   // of each ray
  float least_weight;
  float near;  // metres
};

struct CompositeBackwardConstants {
  CompositeConstants forward;
  uint d_sdf_stride;  // floats, multiples of 4
  uint d_sdf_column;
  uint d_rgb_stride;
  uint d_rgb_column;
  uint rows;  // of the gradients, padding included
};

#ifdef __cplusplus
static_assert(sizeof(CompositeConstants) == 40);
static_assert(sizeof(GroupSamplesConstants) == 20);
static_assert(sizeof(CompositeBackwardConstants) == 60);
}  // namespace arah::shared
#endif
#endif
