// The samples of a batch of rays as compositing reads them, forward and backward alike.
#pragma once

#include "kernels/linear/matrix.h"

namespace arah {

// What the field's values are (kernels/reference/density.h). laplace: signed distances. softplus: −b times a raw density.
enum class DensityKind : uint32_t { laplace, softplus };

// Row of a sample: ray · samples + sample, depths ascending along the ray.
struct CompositeSamples {
  uint32_t rays = 0;          // at least 1
  uint32_t samples = 0;       // of each ray, 1 to 30,000
  Matrix sdf;                 // its first column: the sdf network's value. Strides and columns are multiples of 4
  float metres_per_unit = 1;  // of that value
  Matrix rgb;                 // by row, or by slot where `slots` is given: 3 columns, [0, 1]
  // [rows] vec4; w = 0: the sample is skipped, whatever its numbers; w = shared::EMPTY (shaders/shared/empty_sample.h): it
  // counts among the samples that δ lie between, but has no density, whatever its sdf
  BufferSlice points;
  BufferSlice deltas;         // [rows] float, metres
  BufferSlice parameters;     // float
  uint32_t scale_index = 0;   // of b's free parameter among them; b = |parameter| clipped to [1e-6, 1e6] metres
  // Where only some samples are shaded: [rows] uint, a sample's place in their queue, no_slot for the others, which are
  // black but absorb. Empty: all rows are shaded.
  BufferSlice slots;
  uint32_t slot_count = 0;  // length of the queue
  DensityKind density = DensityKind::laplace;
  bool groups = false;      // a sample in the queue gives its colour to those after it on its ray, up to the next in the queue
};

inline constexpr uint32_t no_slot = 0xffffffff;

}  // namespace arah
