// Regulariser |φ|₂ / n on generated parameters (ARAH.md section 7), of which this is one tensor: the norm over all tensors was
// found before. d_phi += weight φ / (n |φ|); 0 where the norm is 0. Invocation 0 adds the unweighted value where `first` says so.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/losses.h"
#include "shared/optimizer.h"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Constants { ParameterNormConstants c; };
layout(binding = 0, scalar) readonly buffer Norm { GradientNorm norm; };
layout(binding = 1, scalar) readonly buffer Phi { float phi[]; };
layout(binding = 2, scalar) buffer DPhi { float d_phi[]; };
layout(binding = 3, scalar) buffer Losses { float losses[]; };

void main() {
  uint index = gl_GlobalInvocationID.x;
  float length = norm.norm;
  if (index < c.numbers) d_phi[index] += length > 0.0 ? c.weight * c.inverse_count * phi[index] / length : 0.0;
  if (index == 0u && c.first != 0u) losses[c.slot] += length * c.inverse_count;
}
