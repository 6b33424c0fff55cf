// The way back through the pose encoder (kernels/reference/pose_encoder.h): one workgroup goes through the joints, children
// first. Parameter gradients +=, the pose's =.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { PoseEncoderConstants c; };
layout(binding = 0, scalar) readonly buffer Parents { int parents[]; };
layout(binding = 1, scalar) readonly buffer Pose { float pose[]; };
layout(binding = 2, scalar) readonly buffer Parameters { float parameters[]; };
layout(binding = 3, scalar) readonly buffer Inputs { float inputs[]; };
layout(binding = 4, scalar) readonly buffer Hidden { float hidden[]; };
layout(binding = 5, scalar) readonly buffer DCode { float d_code[]; };
layout(binding = 6, scalar) buffer Gradients { float gradients[]; };
layout(binding = 7, scalar) writeonly buffer DPose { float d_pose[]; };  // as Pose

shared float d_out[(most_joints + 1u) * pose_features];  // of the summary first, then joint by joint
shared float d_hidden[pose_hidden];
shared float d_input[pose_hidden];
shared float d_position[most_joints * 3u];
shared float d_rotation[most_joints * 9u];

float position(uint joints, int joint, uint axis) { return joint < 0 ? 0.0 : pose[9u * joints + 3u * uint(joint) + axis]; }

void main() {
  uint lane = gl_LocalInvocationIndex;
  uint joints = c.joints;
  if (lane < pose_features) d_out[lane] = 0.0;
  for (uint i = lane; i < joints * pose_features; i += 64u) d_out[pose_features + i] = d_code[i];
  for (uint i = lane; i < joints * 3u; i += 64u) d_position[i] = 0.0;
  barrier();
  for (uint joint = joints; joint-- > 0u;) {
    int parent = parents[joint];
    uint own = joint * pose_hidden;
    if (lane < pose_hidden) {
      float value = hidden[own + lane];
      float sum = 0.0;
      for (uint f = 0u; f < pose_features; ++f) {
        uint row = joint * pose_features + f;
        float d = d_out[(joint + 1u) * pose_features + f];
        sum += d * parameters[c.w2 + row * pose_hidden + lane];
        gradients[c.w2 + row * pose_hidden + lane] += d * value;
      }
      sum = value > 0.0 ? sum : 0.0;
      d_hidden[lane] = sum;
      gradients[c.b1 + own + lane] += sum;
      for (uint i = 0u; i < pose_hidden; ++i) gradients[c.w1 + (own + lane) * pose_hidden + i] += sum * inputs[own + i];
    }
    if (lane < pose_features) gradients[c.b2 + joint * pose_features + lane] += d_out[(joint + 1u) * pose_features + lane];
    barrier();
    if (lane < pose_hidden) {
      float sum = 0.0;
      for (uint h = 0u; h < pose_hidden; ++h) sum += d_hidden[h] * parameters[c.w1 + (own + h) * pose_hidden + lane];
      d_input[lane] = sum;
    }
    barrier();
    if (lane < pose_features) d_out[uint(parent + 1) * pose_features + lane] += d_input[pose_channels + 1u + lane];
    if (lane < 9u) d_rotation[9u * joint + lane] = d_input[lane];
    if (lane < 3u) {
      float bone = position(joints, int(joint), lane) - position(joints, parent, lane);
      float bone_length = inputs[own + pose_channels];
      float d_bone = bone_length > 0.0 ? d_input[pose_channels] * bone / bone_length : 0.0;
      d_position[3u * joint + lane] += d_input[9u + lane] + d_bone;
      if (parent >= 0) d_position[3u * uint(parent) + lane] -= d_bone;
    }
    barrier();
  }
  if (lane < pose_features) gradients[c.global_b + lane] += d_out[lane];
  for (uint i = lane; i < pose_channels * joints; i += 64u) {
    float sum = i < 9u * joints ? d_rotation[i] : d_position[i - 9u * joints];
    for (uint f = 0u; f < pose_features; ++f) {
      uint weight = c.global_w + f * pose_channels * joints + i;
      sum += d_out[f] * parameters[weight];
      gradients[weight] += d_out[f] * pose[i];
    }
    d_pose[i] = sum;
  }
}
