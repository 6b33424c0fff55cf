// Stratified samples over the kept bins of rays (reference::shell_samples).
#pragma once

#include <array>

#include "kernels/sampling/jitter.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// Row of a sample: ray · samples + sample, depths ascending along the ray.
struct ShellSamplesArgs {
  uint32_t rays = 0;
  uint32_t samples = 0;                     // of each ray
  std::array<float, 3> root_translation{};  // metres, world
  Jitter jitter;                            // off: the middle of each stratum
  BufferSlice ray_list;                     // [rays] Ray (shaders/shared/ray.h)
  BufferSlice kept;                         // [rays] uvec2 (record_shell_bins)
  // out, [padded_points(rays · samples)] each; all 0 for samples of rays without bins and for the padding:
  BufferSlice depths;  // float, metres
  BufferSlice deltas;  // float, metres: length of the kept bins / samples
  BufferSlice points;  // vec4: posed point (world minus the root translation), w = 1: to be solved and rendered
};

void record_shell_samples(Commands& commands, const ShellSamplesArgs& args);

}  // namespace arah
