// Push constants that compositing forward and backward share, checked.
#pragma once

#include "kernels/compositing/samples.h"
#include "shaders/shared/compositing.h"

namespace arah {

// Throws std::invalid_argument, with the numbers, where a stride or column is no multiple of 4 or a ray has
// more samples than a device's loop may run through.
shared::CompositeConstants composite_constants(const CompositeSamples& samples, float last_delta, float least_weight = 0);

// Bytes of the colours that are read: by row or by slot.
uint64_t rgb_bytes(const CompositeSamples& samples);

}  // namespace arah
