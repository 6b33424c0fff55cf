// Y = epilogue(X W + b) for GPUs: a workgroup owns 64 points and, one after the other, tiles of 64 outputs; an invocation
// owns 8 points × 8 outputs of a tile. 16 channels of X and 16 rows of the packed weights at a time pass through shared
// memory: every number that is fetched from there serves 8 products. X lies there transposed, so that an invocation reads
// its points as two vectors; the transposition happens in registers, in blocks of 4 points × 4 channels.
// Groups: x 64 points each; y any number of groups that share the tiles of outputs (an indirect launch has one).
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;
layout(constant_id = 0) const int K = 64;     // multiple of 8
layout(constant_id = 1) const int TILE = 16;  // multiple of 8: width of the packing's tiles, see pack_weights
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Weights { vec4 w[]; };
#include "lib/epilogue.glsl"
#include "lib/linear_input.glsl"

const int CHUNK = 16;  // channels in shared memory
const int QUADS = 16;  // of a tile: 64 points or 64 outputs

shared vec4 x_tile[CHUNK * QUADS];  // [channel][quad of points]
shared vec4 w_tile[CHUNK * QUADS];  // [channel][quad of outputs]

// Texel `quad` of packed row `row` (0: the bias) of all outputs, 0 beyond the last output.
vec4 packed_weight(int quad, int row) {
  const int quads_a_tile = TILE / 4;
  const int at = quad / quads_a_tile * (K + 1) * quads_a_tile + row * quads_a_tile + quad % quads_a_tile;
  if (4 * quad < int(outputs)) return Weights(weights).w[at];  // an address knows no bounds
  return vec4(0);
}

void main() {
  const int local = int(gl_LocalInvocationIndex);
  const int first_point = int(gl_WorkGroupID.x) * 64;
  const int output_tiles = (int(outputs) + 63) / 64;
  // what this invocation brings to shared memory
  const int load_quad = local % QUADS, load_texel = local / QUADS;
  const int load_base = (first_point + 4 * load_quad) * int(x_stride) + int(x_column);
  // what it computes
  const int point_quad = local / 8 * 2, output_quad = local % 8 * 2;

  for (int tile = int(gl_WorkGroupID.y); tile < output_tiles; tile += int(gl_NumWorkGroups.y)) {
    vec4 low[8], high[8];  // of each point: its first and last four outputs
    const bool has_bias = MODE != MODE_TANGENT;  // a tangent has none
    const vec4 bias_low = has_bias ? packed_weight(tile * QUADS + output_quad, 0) : vec4(0);
    const vec4 bias_high = has_bias ? packed_weight(tile * QUADS + output_quad + 1, 0) : vec4(0);
    [[unroll]] for (int i = 0; i < 8; ++i) {
      low[i] = bias_low;
      high[i] = bias_high;
    }
    for (int first = 0; first < K; first += CHUNK) {
      // beyond channel K lie other columns of the row, which may hold anything, NaN included
      vec4 rows[4];
      [[unroll]] for (int i = 0; i < 4; ++i)
        rows[i] = first + 4 * load_texel < K ? read_four(load_base + i * int(x_stride), first / 4 + load_texel) : vec4(0);
      vec4 brought[4];
      [[unroll]] for (int i = 0; i < 4; ++i) {
        const int k = first + load_texel + 4 * i;
        brought[i] = k < K ? packed_weight(tile * QUADS + load_quad, 1 + k) : vec4(0);
      }
      barrier();
      [[unroll]] for (int c = 0; c < 4; ++c)
        x_tile[(4 * load_texel + c) * QUADS + load_quad] = vec4(rows[0][c], rows[1][c], rows[2][c], rows[3][c]);
      [[unroll]] for (int i = 0; i < 4; ++i) w_tile[(load_texel + 4 * i) * QUADS + load_quad] = brought[i];
      barrier();
      for (int k = 0; k < CHUNK; ++k) {
        const vec4 x0 = x_tile[k * QUADS + point_quad], x1 = x_tile[k * QUADS + point_quad + 1];
        const vec4 w0 = w_tile[k * QUADS + output_quad], w1 = w_tile[k * QUADS + output_quad + 1];
        [[unroll]] for (int i = 0; i < 4; ++i) {
          low[i] += x0[i] * w0;
          high[i] += x0[i] * w1;
          low[4 + i] += x1[i] * w0;
          high[4 + i] += x1[i] * w1;
        }
      }
    }
    const int group = tile * 8 + local % 8;  // of 8 outputs
    if (8 * group < int(outputs)) {
      [[unroll]] for (int i = 0; i < 8; ++i) store_group(first_point + 4 * point_quad + i, group, low[i], high[i]);
    }
  }
}
