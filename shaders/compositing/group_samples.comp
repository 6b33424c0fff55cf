// The samples of each ray in groups that share one colour (reference::group_samples). One invocation walks one ray over the
// samples whose weight exceeds `least_weight`. The ray's Σ w is cut into `groups` equal parts, and a sample belongs to the part
// that the middle of its own weight lies in; where its canonical point is farther than `near` from the group's first one, a
// group ends all the same, so that surfaces one behind the other are not mixed. The first sample of a group gets the flag 1
// and the group's place,
//   x̄ = Σ w x̂ / Σ w,
// all other samples the flag 0.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/compositing.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { GroupSamplesConstants c; };
layout(binding = 0, scalar) readonly buffer Weights { float weights[]; };  // 0 where there is no sample
layout(binding = 1, rgba32f) uniform readonly imageBuffer points;
layout(binding = 2, scalar) writeonly buffer Flags { uint flags[]; };
layout(binding = 3, scalar) writeonly buffer Moved { vec4 moved[]; };  // the same memory as `points`

void main() {
  uint ray = gl_GlobalInvocationID.x;
  bool real = ray < c.rays;
  uint samples = c.samples;
  float least_weight = c.least_weight;
  float near_squared = c.near * c.near;
  uint last_group = c.groups - 1u;
  uint first = min(ray, c.rays - 1u) * samples;
  float sum = 0.0;
  for (uint k = 0u; k < samples; ++k) {
    float weight = weights[first + k];
    sum += weight > least_weight ? weight : 0.0;
  }
  float groups_of_weight = float(c.groups) / max(sum, 1e-30);

  float before = 0.0;
  bool open = false;
  uint group = 0u, leader = first;
  vec4 start = vec4(0.0);
  vec3 shift = vec3(0.0);  // Σ w (x̂ − start): a sum of small numbers
  float part = 1.0;
  for (uint k = 0u; k < samples; ++k) {
    uint row = first + k;
    float weight = weights[row];
    bool counts = weight > least_weight;
    vec4 point = imageLoad(points, int(row));
    uint at = min(uint((before + 0.5 * weight) * groups_of_weight), last_group);
    vec3 from = point.xyz - start.xyz;
    bool begins = counts && (!open || at != group || dot(from, from) > near_squared);
    if (begins && open && real) moved[leader] = vec4(start.xyz + shift / part, start.w);
    leader = begins ? row : leader;
    group = begins ? at : group;
    start = begins ? point : start;
    shift = begins ? vec3(0.0) : shift;
    part = begins ? 0.0 : part;
    shift += counts ? weight * (point.xyz - start.xyz) : vec3(0.0);
    part += counts ? weight : 0.0;
    before += counts ? weight : 0.0;
    open = open || begins;
    if (real) flags[row] = begins ? 1u : 0u;
  }
  if (open && real) moved[leader] = vec4(start.xyz + shift / part, start.w);
}
