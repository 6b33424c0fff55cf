// Partial sums of dW = Xᵀ dY and db = Σ dY for GPUs. A workgroup owns 64 channels of X × 64 channels of dY over one split of
// the points; an invocation owns 8 × 8 of them. 16 points at a time pass through shared memory. Writes
// partial[split][channel of X, then one row for db][channel of dY]; reduce_partials adds the splits in fixed order.
// Groups: x row tile · column_tiles + column tile, y split.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer X;
layout(binding = 1, rgba32f) uniform readonly imageBuffer dY;
layout(binding = 2, scalar) restrict writeonly buffer Partial { vec4 partial_sums[]; };
layout(push_constant, scalar) uniform Constants {
  uint x_stride, x_column;    // texels
  uint dy_stride, dy_column;  // texels
  uint row_tiles;             // ceil(inputs / 64)
  uint column_tiles;          // ceil(outputs / 64)
  uint inputs;                // padded channels of X
  uint output_texels;         // padded channels of dY / 4
  uint points_per_split;
  uint points;                // padded points: the last split may be shorter
};

const int CHUNK = 16;  // points in shared memory
const int QUADS = 16;  // of a tile of 64 channels

shared vec4 x_tile[CHUNK * QUADS];   // [point][quad of channels]
shared vec4 dy_tile[CHUNK * QUADS];  // [point][quad of channels]

void main() {
  const int local = int(gl_LocalInvocationIndex);
  const int row_tile = int(gl_WorkGroupID.x / column_tiles), column_tile = int(gl_WorkGroupID.x % column_tiles);
  const int split = int(gl_WorkGroupID.y);
  const int begin = split * int(points_per_split), end = min(begin + int(points_per_split), int(points));
  const int input_texels = int(inputs) / 4;
  const int load_quad = local % QUADS, load_point = local / QUADS;
  const int x_texel = row_tile * QUADS + load_quad, dy_texel = column_tile * QUADS + load_quad;
  const int row_quad = local / 8 * 2, column_quad = local % 8 * 2;

  vec4 low[8], high[8];  // of each channel of X: the first and last four channels of dY
  [[unroll]] for (int i = 0; i < 8; ++i) {
    low[i] = vec4(0);
    high[i] = vec4(0);
  }
  vec4 bias = vec4(0);  // the first 16 invocations add up one quad of dY each
  const bool sums_bias = row_tile == 0 && local < QUADS;
  for (int first = begin; first < end; first += CHUNK) {
    vec4 x[4], dy[4];
    [[unroll]] for (int i = 0; i < 4; ++i) {
      const int point = first + load_point + 4 * i;
      x[i] = point < end && x_texel < input_texels ? imageLoad(X, point * int(x_stride) + int(x_column) + x_texel) : vec4(0);
      dy[i] = point < end && dy_texel < int(output_texels) ? imageLoad(dY, point * int(dy_stride) + int(dy_column) + dy_texel) : vec4(0);
    }
    barrier();
    [[unroll]] for (int i = 0; i < 4; ++i) {
      x_tile[(load_point + 4 * i) * QUADS + load_quad] = x[i];
      dy_tile[(load_point + 4 * i) * QUADS + load_quad] = dy[i];
    }
    barrier();
    for (int n = 0; n < CHUNK; ++n) {
      const vec4 x0 = x_tile[n * QUADS + row_quad], x1 = x_tile[n * QUADS + row_quad + 1];
      const vec4 d0 = dy_tile[n * QUADS + column_quad], d1 = dy_tile[n * QUADS + column_quad + 1];
      [[unroll]] for (int i = 0; i < 4; ++i) {
        low[i] += x0[i] * d0;
        high[i] += x0[i] * d1;
        low[4 + i] += x1[i] * d0;
        high[4 + i] += x1[i] * d1;
      }
    }
    if (sums_bias) {
      for (int n = 0; n < CHUNK; ++n) bias += dy_tile[n * QUADS + local];
    }
  }

  const uint base = uint(split) * (inputs + 1u);
  const uint texel = uint(column_tile * QUADS + column_quad);
  [[unroll]] for (int i = 0; i < 8; ++i) {
    const uint row = uint(row_tile * 64 + 4 * row_quad + i);
    if (row < inputs && texel < output_texels) {
      partial_sums[(base + row) * output_texels + texel] = low[i];
      partial_sums[(base + row) * output_texels + texel + 1u] = high[i];
    }
  }
  if (sums_bias && dy_texel < int(output_texels)) partial_sums[(base + inputs) * output_texels + uint(dy_texel)] = bias;
}
