// The paper's samples: dense around the surface a ray hits, uniform where it hits none (reference::surface_samples,
// uniform_samples, jitter).
#pragma once

#include <array>

#include "kernels/sampling/jitter.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// Row of a sample: ray · slots + slot, depths ascending along the ray, used slots first.
struct SurfaceSamplesArgs {
  uint32_t rays = 0;
  uint32_t slots = 64;                      // of each ray; at least around_surface + before_surface and without_surface
  uint32_t around_surface = 17;             // odd: the middle one is the surface itself, which jitter leaves in place
  uint32_t before_surface = 16;
  uint32_t without_surface = 64;
  float half_width = 0.05F;                 // metres, around the surface
  std::array<float, 3> root_translation{};  // metres, world
  Jitter jitter;
  BufferSlice ray_list;        // [rays] Ray (shaders/shared/ray.h)
  BufferSlice surface_points;  // [rays] vec4 of the joint search; only w is read: 0 where the ray hits no surface
  BufferSlice surface_depths;  // [rays] float, metres; read where the ray hits one
  // out, [padded_points(rays · slots)] each; all 0 for unused slots, rays that miss the box and the padding:
  BufferSlice depths;  // float, metres
  BufferSlice points;  // vec4: posed point (world minus the root translation), w = 1: to be solved and rendered
};

// Throws std::invalid_argument where the counts do not fit the slots, or around_surface is even.
void record_surface_samples(Commands& commands, const SurfaceSamplesArgs& args);

}  // namespace arah
