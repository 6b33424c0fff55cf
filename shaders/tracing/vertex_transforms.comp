// The blended transform T = Σ_k w_k B_k of each point's nearest template vertex, divided by Σ_k w_k as record_nearest_vertex
// inverts it. One invocation serves one row: it writes the three rows of T of the row's point.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#define ROWS_CONSTANT 0
#include "lib/rows.glsl"
#include "shared/frame.h"

layout(local_size_x = 64) in;
layout(binding = 2, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 3, scalar) restrict readonly buffer Nearest { uint nearest[]; };
layout(binding = 4, scalar) restrict readonly buffer Joints { uint joints[]; };  // by vertex, four of 8 bits
layout(binding = 5, rgba32f) uniform readonly imageBuffer weights;               // by vertex
layout(binding = 6, scalar) restrict writeonly buffer Transforms { vec4 transforms[]; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const uint vertex = nearest[point_of_row(row)];
  const uint vertex_joints = joints[vertex];
  const vec4 vertex_weights = imageLoad(weights, int(vertex));
  vec4 t[3] = vec4[3](vec4(0), vec4(0), vec4(0));
  float sum = 0.0;
  [[unroll]] for (int k = 0; k < 4; ++k) {
    const int joint = int(vertex_joints >> (8 * k) & 255u);
    [[unroll]] for (int i = 0; i < 3; ++i) t[i] += vertex_weights[k] * frame.bones[3 * joint + i];
    sum += vertex_weights[k];
  }
  [[unroll]] for (int i = 0; i < 3; ++i) transforms[3u * row + uint(i)] = t[i] / sum;
}
