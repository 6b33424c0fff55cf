// Penalties on the sdf's values (ARAH.md sections 7 and 10), f in cube units: Σ exp(−100 f) / N over points outside the
// body (0), Σ sigmoid(5000 f) / N over points inside (1), Σ |f| / N on the surface (2), Σ exp(−100 |f|) / N off it (3).
// One invocation takes one point: reads f, writes (=) the weighted gradient, channels beyond the first and padding rows
// as 0. Each workgroup leaves its unweighted sum in `partials`.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/stable.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/losses.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint penalty = 0;
layout(constant_id = 1) const uint d_sdf_quads = 2;  // channels / 4 that are written

layout(push_constant, scalar) uniform Constants { SdfPenaltyConstants c; };
layout(binding = 0, scalar) readonly buffer Sdf { float sdf[]; };
layout(binding = 1, scalar) writeonly buffer DSdf { vec4 d_sdf[]; };
layout(binding = 2, scalar) writeonly buffer Partials { float partials[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  bool counts = index < c.points;
  float f = sdf[min(index, c.points - 1u) * c.stride + c.column];
  float value, slope;
  if (penalty == 1u) {
    value = stable_sigmoid(5000.0 * f);
    slope = 5000.0 * value * stable_sigmoid(-5000.0 * f);
  } else if (penalty == 2u) {
    value = abs(f);
    slope = isnan(f) ? f : sign(f);  // a NaN must reach the optimiser's guard
  } else if (penalty == 3u) {
    value = exp(-100.0 * abs(f));
    slope = isnan(f) ? f : -100.0 * value * sign(f);
  } else {
    value = exp(-100.0 * f);
    slope = -100.0 * value;
  }
  float gradient = c.weight * c.inverse_normaliser * slope;
  uint quad_of_row = index * (c.d_stride / 4u) + c.d_column / 4u;
  d_sdf[quad_of_row] = counts ? vec4(gradient, 0.0, 0.0, 0.0) : vec4(0.0);
  for (uint quad = 1u; quad < d_sdf_quads; ++quad) d_sdf[quad_of_row + quad] = vec4(0.0);
  float sum = workgroup_sum(counts ? value * c.inverse_normaliser : 0.0);
  if (gl_LocalInvocationIndex == 0u) partials[gl_WorkGroupID.x] = sum;
}
