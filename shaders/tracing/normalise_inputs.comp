// The networks' input rows: one invocation writes n(x) of one row's canonical point and zeros up to column 8. Rows past the
// count hold zeros.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

#define ROWS_CONSTANT 0
#include "lib/eight_floats.glsl"
#include "lib/rows.glsl"
#include "shared/frame.h"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(constant_id = 2) const bool FROM_ROOT = false;  // of B_0⁻¹ x instead
layout(binding = 2, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 3, rgba32f) uniform readonly imageBuffer canonical;
layout(binding = 4, scalar) restrict writeonly buffer Inputs { u64vec4 inputs[]; };
layout(push_constant, scalar) uniform Constants { NormaliseInputsConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const bool exists = row < row_count(constants.row_limit);
  vec3 x = imageLoad(canonical, point_of_row(row)).xyz;
  if (FROM_ROOT) {
    x -= vec3(frame.bones[0].w, frame.bones[1].w, frame.bones[2].w);
    x = x.x * frame.bones[0].xyz + x.y * frame.bones[1].xyz + x.z * frame.bones[2].xyz;
  }
  const vec3 n = x * frame.cube_scale + frame.cube_offset;
  const u64vec4 packed_row = pack_eight(EightFloats(vec4(n, 0.0), vec4(0)));
  inputs[row * constants.stride + constants.column] = exists ? packed_row : u64vec4(0);
}
