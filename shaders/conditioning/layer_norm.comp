// Layer norm and ReLU of the hypernetwork (kernels/reference/hypernetwork.h): one workgroup a block of `size` numbers.
// Keeps the normalised values and 1 / √(variance + ε) for the way back.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/finite.glsl"
#include "lib/workgroup_sum.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { LayerNormConstants c; };
layout(binding = 0, scalar) readonly buffer A { float a[]; };
layout(binding = 1, scalar) readonly buffer Scale { float scale[]; };
layout(binding = 2, scalar) readonly buffer Shift { float shift[]; };
layout(binding = 3, scalar) writeonly buffer Normalised { float normalised[]; };
layout(binding = 4, scalar) writeonly buffer InverseDeviation { float inverse_deviation[]; };
layout(binding = 5, scalar) writeonly buffer Y { float y[]; };

const float EPSILON = 1e-5;

void main() {
  uint first = gl_WorkGroupID.x * c.size;
  uint lane = gl_LocalInvocationIndex;
  float own = 0.0;
  for (uint i = lane; i < c.size; i += 64u) own += a[first + i];
  float mean = workgroup_sum(own) / float(c.size);
  own = 0.0;
  for (uint i = lane; i < c.size; i += 64u) own += (a[first + i] - mean) * (a[first + i] - mean);
  float inverse = 1.0 / sqrt(workgroup_sum(own) / float(c.size) + EPSILON);
  for (uint i = lane; i < c.size; i += 64u) {
    float n = (a[first + i] - mean) * inverse;
    normalised[first + i] = n;
    y[first + i] = relu(scale[first + i] * n + shift[first + i]);
  }
  if (lane == 0u) inverse_deviation[gl_WorkGroupID.x] = inverse;
}
