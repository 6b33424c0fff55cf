// What the cotangents g on LBS(x) mean for the bone transforms: dL/dB_b = Σ_rows g (w_b [x; 1])ᵀ, 3 × 4 a bone
// (kernels/reference/implicit.h). One invocation adds up one row of one bone's matrix over 64 rows of points; a workgroup
// does 64 such rows. The sums are partial ones, assigned; record_sum adds them up in a fixed order.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#define ROWS_CONSTANT 0
#include "lib/rows.glsl"
#include "shared/skinning.h"

layout(constant_id = 2) const int JOINTS = 1;
layout(constant_id = 3) const bool BY_VERTEX = false;  // weights: of the points' nearest vertices, else by row

layout(local_size_x = 64) in;
layout(binding = 2, rgba32f) uniform readonly imageBuffer cotangents;
layout(binding = 3, rgba32f) uniform readonly imageBuffer canonical;
layout(binding = 4, rgba32f) uniform readonly imageBuffer weights;  // by row [joints], or by vertex its four influences
layout(binding = 5, scalar) restrict readonly buffer Nearest { uint nearest[]; };       // by point: a vertex
layout(binding = 6, scalar) restrict readonly buffer Influences { uint influences[]; };  // by vertex, four joints of 8 bits
layout(binding = 7, scalar) restrict writeonly buffer Partials { vec4 partials[]; };    // [chunks of 64 rows][3 JOINTS]
layout(push_constant, scalar) uniform Constants { BoneGradientConstants constants; };

// A constant index is a register; one that varies would be a load.
float component(vec4 v, int i) { return i == 0 ? v.x : i == 1 ? v.y : i == 2 ? v.z : v.w; }

float weight(uint row, int bone) {
  if (!BY_VERTEX) return component(imageLoad(weights, int(row * constants.weight_stride + constants.weight_column) + (bone >> 2)), bone & 3);
  const uint vertex = nearest[point_of_row(row)];
  const uint joints = influences[vertex];
  const vec4 w = imageLoad(weights, int(vertex));
  float own = 0.0, sum = 0.0;
  [[unroll]] for (int k = 0; k < 4; ++k) {
    own += int(joints >> (8 * k) & 255u) == bone ? w[k] : 0.0;
    sum += w[k];
  }
  return own / sum;
}

void main() {
  const int place = int(gl_GlobalInvocationID.x);
  const int bone = min(place / 3, JOINTS - 1), axis = place % 3;
  const uint first = gl_WorkGroupID.y * 64u, end = min(first + 64u, row_count(constants.rows));
  vec4 sum = vec4(0);
  for (uint row = first; row < end; ++row) {
    const float g = component(imageLoad(cotangents, int(row)), axis);
    sum += g * weight(row, bone) * vec4(imageLoad(canonical, int(row)).xyz, 1.0);
  }
  if (place < 3 * JOINTS) partials[gl_WorkGroupID.y * uint(3 * JOINTS) + uint(place)] = sum;
}
