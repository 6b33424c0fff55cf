// Gradients at the features of LEVELS grids and, where POSITION is not 0, at the point. One invocation serves one point.
// A feature's gradient is a sum over the points around its node. It is added up in 32-bit fixed point, because integer
// addition gives the same sum in any order: a contribution is clamp(dL/dy · scale, ±limit) · weight, rounded to the nearest
// integer. The clamp keeps every sum from wrapping; each clamped contribution is counted.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

#include "lib/feature_grid.glsl"
#include "lib/row_access.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const int LEVELS = 1;    // 1 to 4
layout(constant_id = 1) const int SHIFT = 0;     // first column modulo 4
layout(constant_id = 2) const int POSITION = 0;  // d_position: 0 untouched, 1 assigned, 2 added to
layout(binding = 0, rgba32f) uniform readonly imageBuffer points;
layout(binding = 1, rgba32f) uniform readonly imageBuffer features;
layout(binding = 2, rgba32f) uniform readonly imageBuffer d_rows;
layout(binding = 3, scalar) restrict buffer Sums { int sums[]; };              // [node][4]
layout(binding = 4, scalar) restrict buffer Clamped { uint clamped[]; };       // one counter
layout(binding = 5, scalar) restrict buffer DPosition { vec4 d_position[]; };
layout(push_constant, scalar) uniform Constants {
  FeatureGridBox box;
  FeatureGridLevel levels[4];
  uint row_stride, first_texel;  // texels
  uint count;                    // points that contribute
  float scale;                   // fixed-point units per unit of gradient
  float limit;                   // of |contribution|, in fixed-point units
  float position_factor;
};

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  const bool contributes = uint(point) < count;
  const vec3 x = imageLoad(points, point).xyz;
  const int base = point * int(row_stride) + int(first_texel);
  vec4 before = imageLoad(d_rows, base);
  vec3 d_x = vec3(0);
  [[unroll]] for (int l = 0; l < LEVELS; ++l) {
    const vec4 next = SHIFT == 0 && l + 1 == LEVELS ? vec4(0) : imageLoad(d_rows, base + l + 1);
    const vec4 d = shifted(before, next, SHIFT);
    before = next;
    const GridCell cell = grid_cell(box, levels[l], x);
    const vec4 wanted = d * scale;
    // a NaN fails the comparison and counts as clamped, with the contribution 0
    const bvec4 fits = lessThanEqual(abs(wanted), vec4(limit));
    const bvec4 number = equal(wanted, wanted);
    const vec4 fixed_point = mix(mix(vec4(0), sign(wanted) * limit, number), wanted, fits);
    const bool position_is_number = !any(isnan(x));
    if (contributes && !(all(fits) && position_is_number)) atomicAdd(clamped[0], 1u);
    [[unroll]] for (int corner = 0; corner < 8; ++corner) {
      const int node = corner_node(levels[l], cell, corner);
      const vec3 w = corner_weights(cell, corner);
      if (contributes && position_is_number) {
        const ivec4 share = ivec4(round(w.x * w.y * w.z * fixed_point));
        [[unroll]] for (int c = 0; c < 4; ++c) if (share[c] != 0) atomicAdd(sums[4 * node + c], share[c]);
      }
      if (POSITION != 0) {
        const vec3 slope = mix(-cell.slope, cell.slope, bvec3(corner_bits(corner)));
        d_x += dot(d, imageLoad(features, node)) * slope * vec3(w.y * w.z, w.x * w.z, w.x * w.y);
      }
    }
  }
  if (POSITION == 1) d_position[point] = vec4(position_factor * d_x, 0);
  if (POSITION == 2) d_position[point].xyz += position_factor * d_x;
}
