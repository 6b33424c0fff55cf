// Push constants of shaders/reduction. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_REDUCTION_H
#define ARAH_SHARED_REDUCTION_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#endif

struct SumConstants {
  uint rows;
  uint columns;
  uint sum_index;  // where column 0's sum is added
};

#ifdef __cplusplus
static_assert(sizeof(SumConstants) == 12);
}  // namespace arah::shared
#endif
#endif
