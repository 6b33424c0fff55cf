// Y = epilogue(X W + b) for CPU devices where the layer is wide: a loop whose code and data stay in the innermost caches.
// Eight neighbouring lanes (a cluster, whatever the subgroup size) own 16 points × 64 outputs, lane l the outputs 8l..8l+7.
// For every 8 inputs a lane reads its columns of W once and serves the 16 points with them; X comes as the lane's own two
// points and is passed around by shuffles with constant lanes. A workgroup owns 64 points and all outputs: its 8 clusters take
// the tiles in turns. Reads the packed weights as one tile (row 0 bias, then K rows). One pipeline serves all sizes.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_shuffle : require

layout(local_size_x = 64) in;
layout(binding = 8, rgba32f) uniform readonly imageBuffer W;
#include "lib/epilogue.glsl"
#include "lib/linear_input.glsl"

const int LANES = 8;    // of a cluster
const int POINTS = 16;  // of a cluster: two a lane
const int TEXELS = 2;   // of four inputs in one iteration

void main() {
  const int lane = int(gl_LocalInvocationIndex & 7u);
  const uint neighbours = gl_SubgroupInvocationID & ~7u;
  const int row_texels = int(outputs) / 4;
  const int column_tiles = (int(outputs) + 63) / 64;
  const int input_texels = int(inputs) / 4;
  const int stride = int(x_stride), column = int(x_column);
  for (int task = int(gl_LocalInvocationIndex >> 3); task < 64 / POINTS * column_tiles; task += 8) {
    const int point = int(gl_WorkGroupID.x) * 64 + task / column_tiles * POINTS;
    const int texel = (task % column_tiles * 8 + lane) * 2;
    const int x_base = (point + lane) * stride + column;
    const int x_next = LANES * stride;  // from a lane's point to its next one
    vec4 low[POINTS], high[POINTS];  // of each point: the lane's first and last four outputs
    const vec4 bias_low = MODE == MODE_TANGENT ? vec4(0) : imageLoad(W, texel);  // a tangent has no bias
    const vec4 bias_high = MODE == MODE_TANGENT ? vec4(0) : imageLoad(W, texel + 1);
    [[unroll]] for (int p = 0; p < POINTS; ++p) {
      low[p] = bias_low;
      high[p] = bias_high;
    }
    for (int k = 0; k < input_texels; k += TEXELS) {
      vec4 w_low[4 * TEXELS], w_high[4 * TEXELS];
      [[unroll]] for (int j = 0; j < 4 * TEXELS; ++j) {
        w_low[j] = imageLoad(W, (1 + 4 * k + j) * row_texels + texel);
        w_high[j] = imageLoad(W, (1 + 4 * k + j) * row_texels + texel + 1);
      }
      [[unroll]] for (int first = 0; first < POINTS; first += LANES) {
        vec4 x[TEXELS];
        read_eight(x_base + first / LANES * x_next, k / TEXELS, x[0], x[1]);
        [[unroll]] for (int p = 0; p < LANES; ++p) {
          [[unroll]] for (int j = 0; j < 4 * TEXELS; ++j) {
            const float of_point = subgroupShuffle(x[j / 4][j & 3], neighbours | uint(p));
            low[first + p] += w_low[j] * of_point;
            high[first + p] += w_high[j] * of_point;
          }
        }
      }
    }
    if (texel < row_texels) {
      [[unroll]] for (int p = 0; p < POINTS; ++p) store_group(point + p, texel / 2, low[p], high[p]);
    }
  }
}
