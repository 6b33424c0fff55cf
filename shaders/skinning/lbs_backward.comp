// The way back through linear blend skinning. One invocation turns one row's cotangent g on x_bar into dL/dlogits
// (assigned, padding columns 0) and the part of dL/dx that the weights do not carry: sum_b w_b R_b^T g.
// With dL/dw_b = (B_b x) . g. Rows past the count come out as zeros, so that sums over padded rows are right.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

#define ROWS_CONSTANT 66
#include "lib/rows.glsl"
layout(binding = 2, rgba32f) uniform readonly imageBuffer logit_texels;
#include "lib/hierarchical_softmax.glsl"
#include "lib/store_logits.glsl"
#include "shared/frame.h"
#include "shared/skinning.h"

layout(constant_id = 68) const int COMPONENT = 3;  // 0, 1, 2: g is that unit vector; 3: g is read
layout(constant_id = 69) const bool WRITE_DIRECT = false;

layout(local_size_x = 64) in;
layout(binding = 3, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 4, rgba32f) uniform readonly imageBuffer canonical;
layout(binding = 5, rgba32f) uniform readonly imageBuffer cotangents;
layout(binding = 6, scalar) restrict writeonly buffer DLogits { u64vec4 d_logit_groups[]; };
layout(binding = 7, scalar) writeonly buffer DCanonical { vec4 d_canonical[]; };
layout(push_constant, scalar) uniform Constants { LbsBackwardConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const bool exists = row < row_count(constants.row_limit);
  load_logits(int(row * constants.logit_stride + constants.logit_column));
  distribute_mass();

  vec3 g = vec3(0);
  if (COMPONENT == 3) g = imageLoad(cotangents, int(row)).xyz;
  else g[COMPONENT] = 1.0;
  const vec4 x = vec4(imageLoad(canonical, point_of_row(row)).xyz, 1.0);
  vec3 direct = vec3(0);
  [[unroll]] for (int j = 0; j < JOINTS; ++j) {
    vec4 pulled = vec4(0);  // B_j^T g, of which the last component is the translation's
    if (COMPONENT == 3) {
      [[unroll]] for (int i = 0; i < 3; ++i) pulled += g[i] * frame.bones[3 * j + i];
    } else {
      pulled = frame.bones[3 * j + COMPONENT];
    }
    d_weights[j] = dot(pulled, x);
    direct += weight_of(j) * pulled.xyz;
  }
  pull_back_to_logits();
  const uint base = row * constants.d_logit_stride + constants.d_logit_column;
  [[unroll]] for (int i = 0; i < LOGIT_GROUPS; ++i) d_logit_groups[base + i] = logit_group(i, exists);
  if (WRITE_DIRECT) d_canonical[row] = exists ? vec4(direct, 0.0) : vec4(0);
}
