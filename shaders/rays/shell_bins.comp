// Which of a ray's 64 equal bins lie in the shell around the posed template. One invocation walks one ray: looks the
// signed distance up (trilinear) at each bin's centre, keeps bins below `outer`, stops after the first deeper than
// −inner. Writes 64 bits a ray and their number; rays that miss the box, and the padding, keep none.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/ray.h"
#include "shared/rays.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { ShellBinsConstants c; };
layout(binding = 0, scalar) readonly buffer Rays { Ray rays[]; };
layout(binding = 1, rgba32f) uniform readonly imageBuffer distances;  // four nodes a texel
#include "lib/shell_distance.glsl"
layout(binding = 2, scalar) writeonly buffer Kept { uvec2 kept[]; };
layout(binding = 3, scalar) writeonly buffer KeptCounts { uint kept_counts[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  Ray ray = rays[min(index, c.count - 1u)];
  uvec3 nodes = c.grid.nodes;
  float outer = c.outer;
  float inner = c.inner;
  // Along the ray in units of cells.
  float width = (ray.far - ray.near) * (1.0 / 64.0);
  vec3 stride = ray.direction * (width / c.grid.cell);
  vec3 start = (ray.origin - c.root_translation - c.grid.origin + ray.near * ray.direction) / c.grid.cell + 0.5 * stride;

  uvec2 bits = uvec2(0u);
  bool walking = ray.near < ray.far && index < c.count;
  for (uint bin = 0u; bin < 64u && walking; ++bin) {
    vec3 at = start + float(bin) * stride;
    bool inside;
    float signed_distance = shell_distance(at, nodes, inside);
    // Outside the grid counts as far.
    uint bit = inside && signed_distance < outer ? 1u << (bin & 31u) : 0u;
    bits |= bin < 32u ? uvec2(bit, 0u) : uvec2(0u, bit);
    walking = !(inside && signed_distance < -inner);
  }
  kept[index] = bits;
  kept_counts[index] = uint(bitCount(bits.x) + bitCount(bits.y));
}
