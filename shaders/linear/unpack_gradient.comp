// Effective gradient (dW_eff [padded inputs][padded outputs], then the row db_eff) → gradients of the raw parameters, +=.
// One invocation owns one raw output m. With d_m(k) = dW_eff of raw column k (constant inputs: db_eff · code_k) and s, 1/|W|
// from pack_weights:
//   weight norm  dg = Σ_k d(k) W(k)/|W|;   dW(k) = s (d(k) − dg · W(k)/|W|);   db = db_eff
//   FiLM         dgamma = omega (Σ_k d(k) W(k) + b db_eff);  deta = omega db_eff;  dW(k) = s d(k);  db = s db_eff
//   neither      dW(k) = omega d(k);  db = omega db_eff
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(constant_id = 0) const int KIND = 0;
#include "lib/parameterisation.glsl"
layout(binding = 0, scalar) restrict readonly buffer Effective { float effective[]; };
layout(binding = 1, scalar) restrict readonly buffer Weights { float weights[]; };
layout(binding = 2, scalar) restrict readonly buffer Bias { float bias[]; };
layout(binding = 3, scalar) restrict readonly buffer Code { float code[]; };
layout(binding = 4, scalar) restrict readonly buffer Scales { vec2 scales[]; };
layout(binding = 5, scalar) restrict buffer WeightGradient { float weight_gradient[]; };
layout(binding = 6, scalar) restrict buffer BiasGradient { float bias_gradient[]; };
layout(binding = 7, scalar) restrict buffer FirstGradient { float first_gradient[]; };  // weight norm: dg; FiLM: dgamma
layout(binding = 8, scalar) restrict buffer ShiftGradient { float shift_gradient[]; };  // FiLM: deta

void main() {
  const uint m = gl_GlobalInvocationID.x;
  if (m >= outputs) return;
  const float scale = scales[m].x, inverse_norm = scales[m].y;
  const float bias_effective = effective[padded_inputs * padded_outputs + m];

  float along = 0.0;  // Σ_k d(k) W(k)
  if (KIND != KIND_PLAIN) {
    for (uint k = 0; k < padded_inputs; ++k) {
      const int column = raw_column(k);
      if (column >= 0) along += effective[k * padded_outputs + m] * weights[m * inputs + uint(column)];
    }
    for (uint j = 0; j < constant_count; ++j) along += bias_effective * code[j] * weights[m * inputs + constant_first + j];
  }
  // weight norm removes the part of d along W: dW = s (d − (d·W/|W|²) W)
  const float remove = KIND == KIND_WEIGHT_NORM ? along * inverse_norm * inverse_norm : 0.0;
  for (uint k = 0; k < padded_inputs; ++k) {
    const int column = raw_column(k);
    if (column >= 0) {
      const uint at = m * inputs + uint(column);
      weight_gradient[at] += scale * (effective[k * padded_outputs + m] - remove * weights[at]);
    }
  }
  for (uint j = 0; j < constant_count; ++j) {
    const uint at = m * inputs + constant_first + j;
    weight_gradient[at] += scale * (bias_effective * code[j] - remove * weights[at]);
  }
  if (KIND == KIND_WEIGHT_NORM) {
    bias_gradient[m] += bias_effective;
    first_gradient[m] += along * inverse_norm;
  } else {
    bias_gradient[m] += scale * bias_effective;
    if (KIND == KIND_FILM) {
      first_gradient[m] += omega * (along + bias[m] * bias_effective);
      shift_gradient[m] += omega * bias_effective;
    }
  }
}
