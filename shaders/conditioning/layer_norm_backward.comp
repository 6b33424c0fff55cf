// The way back through ReLU and layer norm (kernels/reference/hypernetwork.h): one workgroup a block. With n the normalised
// values and d = dL/dn: dL/da = (d − mean d − n mean(d n)) / √(variance + ε). Gradients of scale and shift +=, dL/da =.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/workgroup_sum.glsl"
#include "shared/conditioning.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { LayerNormConstants c; };
layout(binding = 0, scalar) readonly buffer DY { float d_y[]; };
layout(binding = 1, scalar) readonly buffer Y { float y[]; };
layout(binding = 2, scalar) readonly buffer Normalised { float normalised[]; };
layout(binding = 3, scalar) readonly buffer InverseDeviation { float inverse_deviation[]; };
layout(binding = 4, scalar) readonly buffer Scale { float scale[]; };
layout(binding = 5, scalar) buffer DScale { float d_scale[]; };
layout(binding = 6, scalar) buffer DShift { float d_shift[]; };
layout(binding = 7, scalar) writeonly buffer DA { float d_a[]; };

void main() {
  uint first = gl_WorkGroupID.x * c.size;
  uint lane = gl_LocalInvocationIndex;
  vec2 own = vec2(0.0);
  for (uint i = first + lane; i < first + c.size; i += 64u) {
    float d = y[i] > 0.0 ? d_y[i] : 0.0;
    d_scale[i] += d * normalised[i];
    d_shift[i] += d;
    own += d * scale[i] * vec2(1.0, normalised[i]);
  }
  vec2 means = workgroup_sum(own) / float(c.size);
  for (uint i = first + lane; i < first + c.size; i += 64u) {
    float d = y[i] > 0.0 ? d_y[i] * scale[i] : 0.0;
    d_a[i] = inverse_deviation[gl_WorkGroupID.x] * (d - means.x - normalised[i] * means.y);
  }
}
