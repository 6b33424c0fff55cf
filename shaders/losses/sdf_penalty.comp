// Penalties on the sdf away from the surface (ARAH.md section 7), f in cube units: Σ exp(−100 f) / N over points
// outside the body, Σ sigmoid(5000 f) / N over points inside. One invocation takes one point: reads f, writes (=) the
// weighted gradient, channels beyond the first and padding rows as 0. Each workgroup leaves its unweighted sum in
// `partials`.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/stable.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/losses.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint inside_body = 0;
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
  if (inside_body != 0u) {
    value = stable_sigmoid(5000.0 * f);
    slope = 5000.0 * value * stable_sigmoid(-5000.0 * f);
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
