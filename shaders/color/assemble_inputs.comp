// Rows of the colour network's input (lib/color_row.glsl). One invocation serves one point: those of workgroup row 0 write
// the position, the view encoding, the normal and the columns up to the next multiple of 8; those of row i > 0 write 32
// further columns of the SDF feature. Columns after the feature become zero.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

#include "lib/color_row.glsl"
#include "lib/row_access.glsl"
#include "lib/view_direction.glsl"
#include "lib/sine.glsl"
#include "shared/frame.h"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 1, rgba32f) uniform readonly imageBuffer canonical;
layout(binding = 2, rgba32f) uniform readonly imageBuffer rays;  // two texels a ray: origin and near, direction and far
layout(binding = 3, rgba32f) uniform readonly imageBuffer normals;
layout(binding = 4, rgba32f) uniform readonly imageBuffer features;
layout(binding = 5, scalar) restrict writeonly buffer Rows { u64vec4 rows[]; };
layout(binding = 6, scalar) restrict readonly buffer Samples { uint samples[]; };  // by point; with INDEXED
layout(binding = 7, rgba32f) uniform readonly imageBuffer transforms;  // three texels by row; with CANONICAL
layout(constant_id = 3) const bool INDEXED = false;
layout(constant_id = 4) const bool CANONICAL = false;  // the view direction in the axes of the canonical pose
layout(constant_id = 5) const bool ROTATED = false;    // by view_rotation, where the surface can be seen so
layout(push_constant, scalar) uniform Constants {
  uint samples_per_ray;
  uint row_stride, row_column;          // groups of 8 floats
  uint row_groups;                      // groups of 8 floats to write
  uint feature_stride, feature_column;  // texels
  float view_rotation[9];               // by row
};

const int HEAD_GROUPS = (FEATURE_AT + 7) / 8;
const int SHIFT = (8 * HEAD_GROUPS - FEATURE_AT) & 3;  // of a written group against the texels of the feature

// Texel t of the feature with zeros after its last column; `base` is the point's first texel.
vec4 feature_texel(int base, int t) {
  const int last = max((FEATURE + 3) / 4 - 1, 0);
  const vec4 value = imageLoad(features, base + clamp(t, 0, last));
  return mix(vec4(0), value, lessThan(4 * t + ivec4(0, 1, 2, 3), ivec4(FEATURE)));
}

void write_head(int point, int feature_base, int row_base) {
  float head[40];
  [[unroll]] for (int i = 0; i < 40; ++i) head[i] = 0.0;
  const vec3 x = imageLoad(canonical, point).xyz * frame.cube_scale + frame.cube_offset;
  [[unroll]] for (int i = 0; i < 3; ++i) head[i] = x[i];
  if (VIEW != 0) {
    const int sample_index = INDEXED ? int(samples[point]) : point;
    const vec3 towards_camera = -imageLoad(rays, 2 * (sample_index / int(samples_per_ray)) + 1).xyz;
    vec3 rows_of_transform[3];
    if (CANONICAL)
      [[unroll]] for (int i = 0; i < 3; ++i) rows_of_transform[i] = imageLoad(transforms, 3 * point + i).xyz;
    vec3 v = CANONICAL ? canonical_direction(rows_of_transform, towards_camera) : towards_camera;
    if (ROTATED) {
      vec3 rotated = vec3(0);
      [[unroll]] for (int i = 0; i < 3; ++i)
        rotated[i] = dot(vec3(view_rotation[3 * i], view_rotation[3 * i + 1], view_rotation[3 * i + 2]), towards_camera);
      if (CANONICAL) rotated = canonical_direction(rows_of_transform, rotated);
      v = dot(imageLoad(normals, point).xyz, rotated) > 0.0 ? rotated : v;
    }
    [[unroll]] for (int i = 0; i < 3; ++i) head[VIEW_AT + i] = v[i];
    [[unroll]] for (int octave = 0; octave < OCTAVES; ++octave) {
      vec4 c;
      const vec4 s = sine(vec4(float(1 << octave) * v, 0), c);
      [[unroll]] for (int i = 0; i < 3; ++i) {
        head[VIEW_AT + 3 + 6 * octave + i] = s[i];
        head[VIEW_AT + 6 + 6 * octave + i] = c[i];
      }
    }
  }
  if (NORMAL != 0) {
    const vec3 n = imageLoad(normals, point).xyz;
    [[unroll]] for (int i = 0; i < 3; ++i) head[NORMAL_AT + i] = n[i];
  }
  if (FEATURE > 0) {
    const vec4 first = feature_texel(feature_base, 0), second = feature_texel(feature_base, 1);
    [[unroll]] for (int i = 0; i < 8 * HEAD_GROUPS - FEATURE_AT; ++i) head[FEATURE_AT + i] = i < 4 ? first[i & 3] : second[i & 3];
  }
  [[unroll]] for (int g = 0; g < HEAD_GROUPS; ++g)
    rows[row_base + g] = pack_floats(vec4(head[8 * g], head[8 * g + 1], head[8 * g + 2], head[8 * g + 3]),
                                     vec4(head[8 * g + 4], head[8 * g + 5], head[8 * g + 6], head[8 * g + 7]));
}

void write_block(int point, int feature_base, int row_base) {
  const int first_group = HEAD_GROUPS + GROUPS_A_BLOCK * (int(gl_WorkGroupID.y) - 1);
  const int first_texel = (8 * first_group - FEATURE_AT) >> 2;
  vec4 texels[2 * GROUPS_A_BLOCK + 1];
  [[unroll]] for (int t = 0; t < 2 * GROUPS_A_BLOCK + 1; ++t) texels[t] = feature_texel(feature_base, first_texel + t);
  [[unroll]] for (int g = 0; g < GROUPS_A_BLOCK; ++g)
    if (first_group + g < int(row_groups))
      rows[row_base + first_group + g] =
          pack_floats(shifted(texels[2 * g], texels[2 * g + 1], SHIFT), shifted(texels[2 * g + 1], texels[2 * g + 2], SHIFT));
}

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  const int feature_base = point * int(feature_stride) + int(feature_column);
  const int row_base = point * int(row_stride) + int(row_column);
  if (gl_WorkGroupID.y == 0u) write_head(point, feature_base, row_base);
  else write_block(point, feature_base, row_base);
}
