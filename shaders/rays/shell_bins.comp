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
layout(binding = 2, scalar) writeonly buffer Kept { uvec2 kept[]; };
layout(binding = 3, scalar) writeonly buffer KeptCounts { uint kept_counts[]; };

// Distances of a node and of the next one along x. The latter lies in the next texel only where the former is the last of its own.
vec2 node_pair(uint node, int last_texel) {
  int texel = int(node >> 2u);
  vec4 here = imageLoad(distances, texel);
  float after = imageLoad(distances, min(texel + 1, last_texel)).x;
  uint place = node & 3u;
  vec2 low = place == 0u ? here.xy : here.yz;
  vec2 high = place == 2u ? here.zw : vec2(here.w, after);
  return place < 2u ? low : high;
}

void main() {
  uint index = gl_GlobalInvocationID.x;
  Ray ray = rays[min(index, c.count - 1u)];
  uvec3 nodes = c.grid.nodes;
  vec3 last = vec3(nodes - 1u);
  int last_texel = int((nodes.x * nodes.y * nodes.z - 1u) >> 2u);
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
    bool inside = all(greaterThanEqual(at, vec3(0.0))) && all(lessThanEqual(at, last));
    vec3 within = clamp(at, vec3(0.0), last);
    uvec3 corner = min(uvec3(within), nodes - 2u);
    vec3 part = within - vec3(corner);
    uint node = (corner.z * nodes.y + corner.y) * nodes.x + corner.x;
    uint above = node + nodes.x * nodes.y;
    vec4 low = vec4(node_pair(node, last_texel), node_pair(node + nodes.x, last_texel));
    vec4 high = vec4(node_pair(above, last_texel), node_pair(above + nodes.x, last_texel));
    vec4 level = mix(low, high, part.z);
    vec2 line = mix(level.xy, level.zw, part.y);
    float signed_distance = mix(line.x, line.y, part.x);
    // Outside the grid counts as far.
    uint bit = inside && signed_distance < outer ? 1u << (bin & 31u) : 0u;
    bits |= bin < 32u ? uvec2(bit, 0u) : uvec2(0u, bit);
    walking = !(inside && signed_distance < -inner);
  }
  kept[index] = bits;
  kept_counts[index] = uint(bitCount(bits.x) + bitCount(bits.y));
}
