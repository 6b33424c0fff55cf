// Partial sums of dW = Xᵀ dY and db = Σ dY for CPU devices. Eight neighbouring lanes (a cluster, whatever the subgroup size)
// own ROWS channels of X × 32 channels of dY over one split of the points: lane l holds dY channels 4l..4l+3.
// A cluster reads 8 points of dY once and uses them for all its ROWS channels; X comes as one texel a lane (its point) and is
// passed around by shuffles with constant lanes. Writes partial[split][channel of X, then one row for db][channel of dY];
// reduce_partials adds the splits in fixed order.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_shuffle : require

layout(local_size_x = 64) in;
layout(constant_id = 0) const int ROWS = 32;  // 8 or 32
layout(binding = 0, rgba32f) uniform readonly imageBuffer X;
layout(binding = 1, rgba32f) uniform readonly imageBuffer dY;
layout(binding = 2, scalar) restrict writeonly buffer Partial { vec4 partial_sums[]; };
layout(push_constant, scalar) uniform Constants {
  uint x_stride, x_column;    // texels
  uint dy_stride, dy_column;  // texels
  uint row_tiles;             // ceil(inputs / ROWS)
  uint column_tiles;          // ceil(outputs / 32)
  uint inputs;                // padded channels of X
  uint output_texels;         // padded channels of dY / 4
  uint points_per_split;      // multiple of 8
  uint points;                // padded points: the last split may be shorter
};

void main() {
  const uint cluster = gl_GlobalInvocationID.x >> 3;
  const uint lane = gl_GlobalInvocationID.x & 7u;
  const uint neighbours = gl_SubgroupInvocationID & ~7u;
  const uint column_tile = cluster % column_tiles;
  const uint row_tile = (cluster / column_tiles) % row_tiles;
  const uint split = cluster / (column_tiles * row_tiles);
  const uint texel = column_tile * 8u + lane;
  const int dy_base = int(dy_column + texel);
  const int x_base = int(x_column + row_tile * (uint(ROWS) / 4u));
  const int begin = int(min(split * points_per_split, points));
  const int end = int(min((split + 1u) * points_per_split, points));

  vec4 sum[ROWS];
  vec4 bias = vec4(0);
  [[unroll]] for (int r = 0; r < ROWS; ++r) sum[r] = vec4(0);
  for (int n = begin; n < end; n += 8) {
    vec4 dy[8];
    [[unroll]] for (int j = 0; j < 8; ++j) dy[j] = imageLoad(dY, (n + j) * int(dy_stride) + dy_base);
    [[unroll]] for (int j = 0; j < 8; ++j) bias += dy[j];
    [[unroll]] for (int q = 0; q < ROWS / 4; ++q) {
      const vec4 x = imageLoad(X, (n + int(lane)) * int(x_stride) + x_base + q);
      // two channels at a time: 8 accumulators stay in registers
      [[unroll]] for (int j = 0; j < 8; ++j) {
        sum[4 * q] += dy[j] * subgroupShuffle(x.x, neighbours | uint(j));
        sum[4 * q + 1] += dy[j] * subgroupShuffle(x.y, neighbours | uint(j));
      }
      [[unroll]] for (int j = 0; j < 8; ++j) {
        sum[4 * q + 2] += dy[j] * subgroupShuffle(x.z, neighbours | uint(j));
        sum[4 * q + 3] += dy[j] * subgroupShuffle(x.w, neighbours | uint(j));
      }
    }
  }
  if (texel < output_texels) {
    const uint first = split * (inputs + 1u);
    [[unroll]] for (int r = 0; r < ROWS; ++r)
      if (row_tile * uint(ROWS) + uint(r) < inputs) partial_sums[(first + row_tile * uint(ROWS) + uint(r)) * output_texels + texel] = sum[r];
    if (row_tile == 0u) partial_sums[(first + inputs) * output_texels + texel] = bias;
  }
}
