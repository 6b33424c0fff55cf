// dx_k = Σ_r dy_r W[r][k]: a workgroup adds up gradient_rows rows of 64 columns, or of 256 where texels hold whole columns, in
// order, and leaves partials[rows of workgroups][blocks][columns]; reduction/sum adds those.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/elements.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint columns = 4;
layout(push_constant, scalar) uniform Constants { VectorLayerConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer weights;
layout(binding = 1, rgba32f) uniform readonly imageBuffer d_y;
layout(binding = 2, scalar) writeonly buffer Partials { float partials[]; };

void main() {
  uint first = gl_WorkGroupID.y * gradient_rows;
  uint count = min(gradient_rows, c.rows - first);
  uint block = gl_WorkGroupID.z;
  uint row = block * c.rows + first;
  uint out_row = (gl_WorkGroupID.y * c.blocks + block) * columns;
  if (columns % 4u == 0u) {
    uint quad = gl_GlobalInvocationID.x;
    uint quads = columns / 4u;
    uint at = min(quad, quads - 1u);
    vec4 sums = vec4(0.0);
    for (uint r = 0u; r < count; ++r) sums += ELEMENT(d_y, row + r) * imageLoad(weights, int((row + r) * quads + at));
    if (quad < quads) {
      for (uint i = 0u; i < 4u; ++i) partials[out_row + 4u * quad + i] = component(sums, i);
    }
  } else {
    uint column = gl_GlobalInvocationID.x;
    uint at = min(column, columns - 1u);
    float sum = 0.0;
    for (uint r = 0u; r < count; ++r) sum += ELEMENT(d_y, row + r) * ELEMENT(weights, (row + r) * columns + at);
    if (column < columns) partials[out_row + column] = sum;
  }
}
