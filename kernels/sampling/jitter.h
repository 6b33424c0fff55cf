// Random offsets of samples: numbers of shaders/lib/random.glsl under the key (seed, step, ray, sample).
#pragma once

#include <cstdint>

namespace arah {

struct Jitter {
  bool on = false;         // training; off for pictures that must repeat
  uint32_t seed = 0;       // of the run
  uint32_t step = 0;       // of the training
  uint32_t first_ray = 0;  // number of the batch's ray 0: batches cut into pieces draw the same numbers
};

}  // namespace arah
