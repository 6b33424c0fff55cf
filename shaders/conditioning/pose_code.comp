// The hierarchical pose encoder (kernels/reference/pose_encoder.h): one workgroup goes through the joints, parents first.
// Keeps each joint's input and hidden values for the way back.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/finite.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { PoseEncoderConstants c; };
layout(binding = 0, scalar) readonly buffer Parents { int parents[]; };
layout(binding = 1, scalar) readonly buffer Pose { float pose[]; };  // [joints][9] rotations, then [joints][3] positions
layout(binding = 2, scalar) readonly buffer Parameters { float parameters[]; };
layout(binding = 3, scalar) writeonly buffer Inputs { float inputs[]; };  // [joints][pose_hidden]
layout(binding = 4, scalar) writeonly buffer Hidden { float hidden[]; };  // [joints][pose_hidden]
layout(binding = 5, scalar) writeonly buffer Code { float code[]; };      // [joints][pose_features]

shared float code_of[(most_joints + 1u) * pose_features];  // the summary of the whole pose first, then joint by joint
shared float input_of[pose_hidden];
shared float hidden_of[pose_hidden];

float position(uint joints, int joint, uint axis) { return joint < 0 ? 0.0 : pose[9u * joints + 3u * uint(joint) + axis]; }

void main() {
  uint lane = gl_LocalInvocationIndex;
  uint joints = c.joints;
  if (lane < pose_features) {
    float sum = parameters[c.global_b + lane];
    for (uint i = 0u; i < pose_channels * joints; ++i) sum += parameters[c.global_w + lane * pose_channels * joints + i] * pose[i];
    code_of[lane] = sum;
  }
  barrier();
  for (uint joint = 0u; joint < joints; ++joint) {
    int parent = parents[joint];
    if (lane < pose_hidden) {
      float value;
      if (lane < 9u) value = pose[9u * joint + lane];
      else if (lane < pose_channels) value = position(joints, int(joint), lane - 9u);
      else if (lane == pose_channels) {
        vec3 bone;
        for (uint axis = 0u; axis < 3u; ++axis) bone[axis] = position(joints, int(joint), axis) - position(joints, parent, axis);
        value = length(bone);
      } else value = code_of[uint(parent + 1) * pose_features + lane - pose_channels - 1u];
      input_of[lane] = value;
      inputs[joint * pose_hidden + lane] = value;
    }
    barrier();
    if (lane < pose_hidden) {
      uint row = joint * pose_hidden + lane;
      float sum = parameters[c.b1 + row];
      for (uint i = 0u; i < pose_hidden; ++i) sum += parameters[c.w1 + row * pose_hidden + i] * input_of[i];
      hidden_of[lane] = relu(sum);
      hidden[row] = relu(sum);
    }
    barrier();
    if (lane < pose_features) {
      uint row = joint * pose_features + lane;
      float sum = parameters[c.b2 + row];
      for (uint i = 0u; i < pose_hidden; ++i) sum += parameters[c.w2 + row * pose_hidden + i] * hidden_of[i];
      code_of[(joint + 1u) * pose_features + lane] = sum;
      code[row] = sum;
    }
    barrier();
  }
}
