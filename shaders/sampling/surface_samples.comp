// The paper's samples of a ray (kernels/reference/sampling.h): where it meets the surface at depth d, `around_surface`
// equally spaced ones on d ± half_width merged with `before_surface` from near to there; elsewhere `without_surface`
// from near to far. One invocation walks one ray in ascending depth and writes its slots in order; unused slots, rays
// that miss the box and the padding after the last row get depth 0 and point (0, 0, 0, 0).
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/random.glsl"
#include "shared/ray.h"
#include "shared/sampling.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { SurfaceSamplesConstants c; };
layout(binding = 0, scalar) readonly buffer Rays { Ray rays[]; };
layout(binding = 1, scalar) readonly buffer SurfacePoints { float surface_points[]; };  // 4 a ray; the last is 0 on a miss
layout(binding = 2, scalar) readonly buffer SurfaceDepths { float surface_depths[]; };
layout(binding = 3, scalar) writeonly buffer Depths { float depths[]; };
layout(binding = 4, scalar) writeonly buffer Points { vec4 points[]; };

// index-th of `count` equally spaced numbers from first to last, both included.
float spaced(float first, float last, uint count, uint index) {
  return count == 1u ? first : first + (last - first) * (float(index) / float(count - 1u));
}

// Two ascending sequences, merged; the second is empty for a ray without surface.
struct Merge {
  float first_from, first_to;
  uint first_count;
  float surface, half_width;
  uint second_count;
  uint taken_first, taken_second;
};

struct Taken {
  float depth;
  bool surface;
};

Taken take(inout Merge m) {
  bool middle = m.taken_second == m.second_count / 2u;
  float second = middle ? m.surface
                        : spaced(m.surface - m.half_width, m.surface + m.half_width, m.second_count, m.taken_second);
  float first = spaced(m.first_from, m.first_to, m.first_count, m.taken_first);
  // Of equal depths the ones in front come first.
  bool take_first = m.taken_first < m.first_count && (m.taken_second >= m.second_count || first <= second);
  m.taken_first += take_first ? 1u : 0u;
  m.taken_second += take_first ? 0u : 1u;
  return Taken(take_first ? first : second, !take_first && middle);
}

void main() {
  uint index = gl_GlobalInvocationID.x;
  uint ray_index = min(index, c.rays - 1u);
  Ray ray = rays[ray_index];
  bool hit = surface_points[4u * ray_index + 3u] != 0.0;
  float surface = hit ? surface_depths[ray_index] : 0.0;
  uint slots = c.slots;
  float half_width = c.half_width;
  vec3 origin = ray.origin - c.root_translation;
  uint rows = (c.rays * slots + 63u) & ~63u;
  bool inside = index < c.rays && ray.near < ray.far;

  Merge merge;
  merge.first_from = ray.near;
  merge.first_to = hit ? ray.near + max(surface - half_width - ray.near, 1e-5) : ray.far;
  merge.first_count = hit ? c.before_surface : c.without_surface;
  merge.surface = surface;
  merge.half_width = half_width;
  merge.second_count = hit ? c.around_surface : 0u;
  merge.taken_first = 0u;
  merge.taken_second = 0u;
  uint count = merge.first_count + merge.second_count;

  Taken now = take(merge);
  float lower = now.depth;
  for (uint slot = 0u; slot < slots; ++slot) {
    Taken next = take(merge);
    float upper = slot + 1u < count ? 0.5 * (now.depth + next.depth) : now.depth;
    float random = random_unit(c.seed, c.step_index, c.first_ray + ray_index, slot);
    bool moved = c.jitter != 0u && !now.surface;
    float depth = moved ? lower + (upper - lower) * random : now.depth;
    bool valid = inside && slot < count;
    uint row = index * slots + slot;
    if (row < rows) {
      depths[row] = valid ? depth : 0.0;
      points[row] = valid ? vec4(origin + depth * ray.direction, 1.0) : vec4(0.0);
    }
    lower = upper;
    now = next;
  }
}
