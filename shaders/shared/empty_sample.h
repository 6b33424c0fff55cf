// The w of a sample's point. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_EMPTY_SAMPLE_H
#define ARAH_SHARED_EMPTY_SAMPLE_H
#ifdef __cplusplus
namespace arah::shared {
#endif

// More than 0: wanted, later found; 0: no sample, or no correspondence; EMPTY: a sample where nothing can be. It counts among
// its ray's samples, with no density, and needs no correspondence.
const float EMPTY = -1.0f;

#ifdef __cplusplus
}  // namespace arah::shared
#endif
#endif
