// From the gradient at the colour network's input rows to those at its parts: the transpose of assemble_inputs. One
// invocation serves one point: those of workgroup row 0 write the gradients at n(x) and at the normal, those of row i > 0
// 32 columns of the gradient at the SDF feature, with zeros after its last column. The view direction needs no gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

#include "lib/color_row.glsl"
#include "lib/row_access.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer d_rows;
layout(binding = 1, scalar) restrict writeonly buffer DPosition { vec4 d_position[]; };
layout(binding = 2, scalar) restrict writeonly buffer DNormal { vec4 d_normal[]; };
layout(binding = 3, scalar) restrict writeonly buffer DFeature { u64vec4 d_feature[]; };
layout(push_constant, scalar) uniform Constants {
  uint row_stride, row_column;          // texels
  uint feature_stride, feature_column;  // groups of 8 floats
};

const int SHIFT = FEATURE_AT & 3;
const int FEATURE_GROUPS = (FEATURE + 7) / 8;

// Feature columns 4 t to 4 t + 3, with zeros after the last one.
vec4 feature_columns(int row_base, int t) {
  const int last = (FEATURE_AT + FEATURE - 1) / 4;
  const int texel = FEATURE_AT / 4 + t;
  const vec4 value = shifted(imageLoad(d_rows, row_base + min(texel, last)), imageLoad(d_rows, row_base + min(texel + 1, last)), SHIFT);
  return mix(vec4(0), value, lessThan(4 * t + ivec4(0, 1, 2, 3), ivec4(FEATURE)));
}

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  const int row_base = point * int(row_stride) + int(row_column);
  if (gl_WorkGroupID.y == 0u) {
    d_position[point] = vec4(imageLoad(d_rows, row_base).xyz, 0);
    if (NORMAL != 0) {
      const vec4 a = imageLoad(d_rows, row_base + NORMAL_AT / 4);
      const vec4 b = imageLoad(d_rows, row_base + (NORMAL_AT + 2) / 4);
      d_normal[point] = vec4(shifted(a, b, NORMAL_AT & 3).xyz, 0);
    }
  } else {
    const int first_group = GROUPS_A_BLOCK * (int(gl_WorkGroupID.y) - 1);
    const int base = point * int(feature_stride) + int(feature_column);
    [[unroll]] for (int g = 0; g < GROUPS_A_BLOCK; ++g)
      if (first_group + g < FEATURE_GROUPS)
        d_feature[base + first_group + g] =
            pack_floats(feature_columns(row_base, 2 * (first_group + g)), feature_columns(row_base, 2 * (first_group + g) + 1));
  }
}
