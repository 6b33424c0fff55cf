// What the watch over a step's numbers leaves. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_WATCH_H
#define ARAH_SHARED_WATCH_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#endif

// Of one watched tensor. All zero: nothing bad was seen.
struct WatchRecord {
  uint nan;
  uint infinite;
  uint beyond;           // finite, but of a magnitude above the limit
  uint first_inverted;   // the bits of the first bad number's place, inverted, so that the first is the largest; 0: none
};

struct WatchConstants {
  uint rows;
  uint channels;   // 1 to 4
  uint stride;     // floats
  uint column;     // floats
  uint first_row;  // number of row 0
  float limit;
};

#ifdef __cplusplus
static_assert(sizeof(WatchRecord) == 16);
static_assert(sizeof(WatchConstants) == 24);
}  // namespace arah::shared
#endif
#endif
