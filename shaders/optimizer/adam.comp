// One Adam step (ARAH.md section 7; kernels/reference/adam.h) and the weights' moving average. One invocation takes 8
// neighbouring numbers: reads and writes (=) parameter, m, v and average, reads the gradient.
// A group whose gradient norm is not finite is left as it is.
// Lazy: the gradient is int32 in fixed point; where all 8 words are 0 nothing is touched, moments and average included;
// elsewhere the words are set back to 0.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "lib/eight_floats.glsl"
#include "shared/optimizer.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint lazy = 0;
layout(constant_id = 1) const uint with_norm = 1;  // 0: `norms` is not read, the gradient is taken as it is
layout(constant_id = 2) const uint with_average = 1;

layout(push_constant, scalar) uniform Constants { AdamConstants c; };
layout(binding = 0, scalar) buffer Parameters { u64vec4 parameters[]; };
layout(binding = 1, scalar) buffer Gradients { u64vec4 gradients[]; };
layout(binding = 2, scalar) buffer FirstMoments { u64vec4 first_moments[]; };
layout(binding = 3, scalar) buffer SecondMoments { u64vec4 second_moments[]; };
layout(binding = 4, scalar) buffer Averages { u64vec4 averages[]; };
layout(binding = 5, scalar) readonly buffer Norms { GradientNorm norms[]; };

void step4(inout vec4 p, vec4 gradient, inout vec4 m, inout vec4 v, inout vec4 average, float scale) {
  vec4 g = scale * gradient + c.weight_decay * p;
  m = c.beta1 * m + c.one_minus_beta1 * g;
  v = c.beta2 * v + c.one_minus_beta2 * g * g;
  p -= c.step_size * m / (sqrt(v * c.inverse_correction2) + c.epsilon);
  average += c.one_minus_average_decay * (p - average);
}

// at is below the number of eights.
void step8(uint at, EightFloats gradient, float scale) {
  EightFloats p = unpack_eight(parameters[at]);
  EightFloats m = unpack_eight(first_moments[at]);
  EightFloats v = unpack_eight(second_moments[at]);
  EightFloats average = EightFloats(vec4(0.0), vec4(0.0));
  if (with_average != 0u) average = unpack_eight(averages[at]);
  step4(p.low, gradient.low, m.low, v.low, average.low, scale);
  step4(p.high, gradient.high, m.high, v.high, average.high, scale);
  parameters[at] = pack_eight(p);
  first_moments[at] = pack_eight(m);
  second_moments[at] = pack_eight(v);
  if (with_average != 0u) averages[at] = pack_eight(average);
}

void main() {
  uint at = gl_GlobalInvocationID.x;
  float scale = 1.0;
  bool usable = at < c.eights;
  if (with_norm != 0u) {
    scale = norms[c.norm_index].scale;
    usable = usable && norms[c.norm_index].usable != 0u;
  }
  u64vec4 words = gradients[min(at, c.eights - 1u)];
  if (lazy != 0u) {
    bool touched = any(notEqual(words, u64vec4(0ul)));
    if (usable && touched) {
      ivec4 low = ivec4(unpackUint2x32(words.x), unpackUint2x32(words.y));
      ivec4 high = ivec4(unpackUint2x32(words.z), unpackUint2x32(words.w));
      step8(at, EightFloats(c.gradient_unit * vec4(low), c.gradient_unit * vec4(high)), scale);
      gradients[at] = u64vec4(0ul);
    }
  } else if (usable) {
    step8(at, unpack_eight(words), scale);
  }
}
