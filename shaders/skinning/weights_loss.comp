// The skinning loss: one invocation compares one point's skinning weights with the template's four,
// sum_b |w_b - target_b| or the cross entropy -sum_b target_b log(w_b + 1e-12), and writes scale · its gradient to
// dL/dlogits (assigned; the derivative of |x| is 0 at 0).
// Each workgroup of 64 points writes its scaled sum to partial_sums; reduction/sum adds these up.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

layout(binding = 0, rgba32f) uniform readonly imageBuffer logit_texels;
#include "lib/hierarchical_softmax.glsl"
#include "lib/store_logits.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/skinning.h"

layout(constant_id = 66) const bool CROSS_ENTROPY = false;
const float LEAST_WEIGHT = 1e-12;  // where log would run away

layout(local_size_x = 64) in;
layout(binding = 1, scalar) restrict readonly buffer TargetJoints { uint target_joints[]; };
layout(binding = 2, rgba32f) uniform readonly imageBuffer target_weights;
layout(binding = 3, scalar) restrict writeonly buffer DLogits { u64vec4 d_logit_groups[]; };
layout(binding = 4, scalar) restrict writeonly buffer PartialSums { float partial_sums[]; };
layout(push_constant, scalar) uniform Constants { WeightsLossConstants constants; };

void main() {
  const uint point = gl_GlobalInvocationID.x;
  const bool exists = point < constants.points;
  load_logits(int(point * constants.logit_stride + constants.logit_column));
  distribute_mass();

  const uint packed_joints = target_joints[point];
  const vec4 targets = imageLoad(target_weights, int(point));
  float loss = 0.0;
  [[unroll]] for (int j = 0; j < JOINTS; ++j) {
    float target = 0.0;
    [[unroll]] for (int k = 0; k < 4; ++k) target += int(packed_joints >> (8 * k) & 255u) == j ? targets[k] : 0.0;
    if (CROSS_ENTROPY) {
      const float weight = weight_of(j) + LEAST_WEIGHT;
      loss -= target * log(weight);
      d_weights[j] = -constants.scale * target / weight;
    } else {
      const float difference = weight_of(j) - target;
      loss += abs(difference);
      d_weights[j] = difference > 0.0 ? constants.scale : difference < 0.0 ? -constants.scale : 0.0;
    }
  }
  pull_back_to_logits();
  const uint base = point * constants.d_logit_stride + constants.d_logit_column;
  [[unroll]] for (int i = 0; i < LOGIT_GROUPS; ++i) d_logit_groups[base + i] = logit_group(i, exists);
  const float sum = workgroup_sum(exists ? constants.scale * loss : 0.0);
  if (gl_LocalInvocationIndex == 0u) partial_sums[gl_WorkGroupID.x] = sum;
}
