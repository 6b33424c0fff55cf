// Gradient of inputs that are constant over the batch (a latent code): dcode_j += Σ_m s_m W[m][constant_first + j] db_eff_m,
// in order of m. One invocation owns one j.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
#include "lib/parameterisation.glsl"
layout(binding = 0, scalar) restrict readonly buffer Effective { float effective[]; };
layout(binding = 1, scalar) restrict readonly buffer Weights { float weights[]; };
layout(binding = 2, scalar) restrict readonly buffer Scales { vec2 scales[]; };
layout(binding = 3, scalar) restrict buffer CodeGradient { float code_gradient[]; };

void main() {
  const uint j = gl_GlobalInvocationID.x;
  if (j >= constant_count) return;
  float sum = 0.0;
  for (uint m = 0; m < outputs; ++m)
    sum += scales[m].x * weights[m * inputs + constant_first + j] * effective[padded_inputs * padded_outputs + m];
  code_gradient[j] += sum;
}
