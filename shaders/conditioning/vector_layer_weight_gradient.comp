// dW[r][k] += dy_r x_k and db_r += dy_r, one invocation a number of W.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/elements.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint columns = 4;
layout(push_constant, scalar) uniform Constants { VectorLayerConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer d_y;
layout(binding = 1, rgba32f) uniform readonly imageBuffer x;
layout(binding = 2, scalar) buffer DWeights { float d_weights[]; };
layout(binding = 3, scalar) buffer DBias { float d_bias[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  uint row = index / columns, column = index % columns;
  if (row >= c.rows * c.blocks) return;
  float d = ELEMENT(d_y, row);
  d_weights[index] += d * ELEMENT(x, row / c.rows * c.input_stride + c.first_input + column);
  if (column == 0u) d_bias[row] += d;
}
