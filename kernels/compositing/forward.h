// Alpha compositing along rays (reference::composite; ARAH.md section 6).
#pragma once

#include "kernels/compositing/samples.h"
#include "kernels/vulkan/commands.h"

namespace arah {

enum class DeltaMode {
  given,        // samples.deltas is read: a stratum's share of the shell
  differences,  // samples.deltas is written first: distance to the ray's next valid sample, last_delta for the last
};

struct CompositeForwardArgs {
  CompositeSamples samples;
  DeltaMode delta_mode = DeltaMode::given;
  float last_delta = 1.0F / 64;  // metres
  BufferSlice depths;            // [rows] float, metres
  BufferSlice colors;            // out: [padded_points(rays)] vec4 (rgb on black, Σ w clipped to 1)
  BufferSlice ray_depths;        // out: [padded_points(rays)] float Σ w z, metres; not divided by Σ w
  BufferSlice weights;           // out: [rows] float
  BufferSlice transmittances;    // out: [rows] float, before each sample; for the way back
  // Given: nothing is shaded yet. samples.rgb and slots are not read, colors get black and Σ w, and flags [rows] uint
  // become 1 where the weight exceeds least_weight: the samples that are worth a colour.
  BufferSlice flags;
  float least_weight = 0;
};

void record_composite_forward(Commands& commands, const CompositeForwardArgs& args);

}  // namespace arah
