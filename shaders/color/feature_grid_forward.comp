// Trilinear features of LEVELS grids at a point, written into four columns a level of the point's row. One invocation serves
// one point. The columns may begin anywhere in the row, so they are stored one by one.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#include "lib/feature_grid.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const int LEVELS = 1;  // 1 to 4
layout(binding = 0, rgba32f) uniform readonly imageBuffer points;
layout(binding = 1, rgba32f) uniform readonly imageBuffer features;
layout(binding = 2, scalar) restrict writeonly buffer Rows { float rows[]; };
layout(push_constant, scalar) uniform Constants {
  FeatureGridBox box;
  FeatureGridLevel levels[4];
  uint row_stride, first_column;
};

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  const vec3 x = imageLoad(points, point).xyz;
  const uint base = uint(point) * row_stride + first_column;
  [[unroll]] for (int l = 0; l < LEVELS; ++l) {
    const GridCell cell = grid_cell(box, levels[l], x);
    vec4 sum = vec4(0);
    [[unroll]] for (int corner = 0; corner < 8; ++corner) {
      const vec3 w = corner_weights(cell, corner);
      sum += w.x * w.y * w.z * imageLoad(features, corner_node(levels[l], cell, corner));
    }
    [[unroll]] for (int c = 0; c < 4; ++c) rows[base + uint(4 * l + c)] = sum[c];
  }
}
