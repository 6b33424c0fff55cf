// One linear layer for one vector: y_r = b_r + Σ_k W[r][k] x_k, one invocation a row. Of several matrices one below the other
// each reads its own part of x.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/elements.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint columns = 4;
layout(push_constant, scalar) uniform Constants { VectorLayerConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer weights;
layout(binding = 1, rgba32f) uniform readonly imageBuffer x;
layout(binding = 2, scalar) readonly buffer Bias { float bias[]; };
layout(binding = 3, scalar) writeonly buffer Y { float y[]; };

void main() {
  uint rows = c.rows * c.blocks;
  uint row = min(gl_GlobalInvocationID.x, rows - 1u);
  uint from = row / c.rows * c.input_stride + c.first_input;
  float sum = 0.0;
  if (columns % 4u == 0u) {
    vec4 sums = vec4(0.0);
    int w = int(row * (columns / 4u)), v = int(from / 4u);
    for (int k = 0; k < int(columns / 4u); ++k) sums += imageLoad(weights, w + k) * imageLoad(x, v + k);
    sum = (sums.x + sums.y) + (sums.z + sums.w);
  } else {
    for (uint k = 0u; k < columns; ++k) sum += ELEMENT(weights, row * columns + k) * ELEMENT(x, from + k);
  }
  float value = bias[row] + sum;
  if (gl_GlobalInvocationID.x < rows) y[row] = value;
}
