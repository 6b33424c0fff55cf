// Linear blend skinning with the weights of the skinning network's logits. One invocation moves one row's canonical point:
// x_bar = sum_b w_b B_b x. Straight-line code: rows past the count are computed too and come out as zeros.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

#define ROWS_CONSTANT 66
#include "lib/rows.glsl"
layout(binding = 2, rgba32f) uniform readonly imageBuffer logit_texels;
#include "lib/hierarchical_softmax.glsl"
#include "lib/eight_floats.glsl"
#include "shared/frame.h"
#include "shared/skinning.h"

layout(constant_id = 68) const bool WRITE_TRANSFORMS = false;
layout(constant_id = 69) const bool WRITE_WEIGHTS = false;

layout(local_size_x = 64) in;
layout(binding = 3, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 4, rgba32f) uniform readonly imageBuffer canonical;
layout(binding = 5, scalar) restrict writeonly buffer Posed { vec4 posed[]; };
layout(binding = 6, scalar) writeonly buffer Transforms { vec4 transforms[]; };
layout(binding = 7, scalar) writeonly buffer Weights { u64vec4 weights[]; };
layout(push_constant, scalar) uniform Constants { LbsConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const bool exists = row < row_count(constants.row_limit);
  load_logits(int(row * constants.logit_stride + constants.logit_column));
  distribute_mass();

  vec4 transform[3] = vec4[3](vec4(0), vec4(0), vec4(0));
  [[unroll]] for (int j = 0; j < JOINTS; ++j) {
    const float weight = weight_of(j);
    [[unroll]] for (int i = 0; i < 3; ++i) transform[i] += weight * frame.bones[3 * j + i];
  }
  const vec4 x = vec4(imageLoad(canonical, point_of_row(row)).xyz, 1.0);
  const vec3 x_bar = vec3(dot(transform[0], x), dot(transform[1], x), dot(transform[2], x));
  posed[row] = exists ? vec4(x_bar, 0.0) : vec4(0);
  if (WRITE_TRANSFORMS) {
    [[unroll]] for (int i = 0; i < 3; ++i) transforms[3 * row + i] = exists ? transform[i] : vec4(0);
  }
  if (WRITE_WEIGHTS) {
    const uint base = row * constants.weight_stride + constants.weight_column;
    [[unroll]] for (int g = 0; g < (JOINTS + 7) / 8; ++g) {
      float w[8];
      [[unroll]] for (int k = 0; k < 8; ++k) w[k] = 8 * g + k < JOINTS && exists ? weight_of(min(8 * g + k, JOINTS - 1)) : 0.0;
      weights[base + g] = pack_eight(EightFloats(vec4(w[0], w[1], w[2], w[3]), vec4(w[4], w[5], w[6], w[7])));
    }
  }
}
