// One Adam step (ARAH.md section 7; kernels/reference/adam.h) and the weights' moving average. One invocation takes 8
// neighbouring numbers, an eight: reads and writes (=) parameter, m, v and average, reads the gradient.
// A group whose gradient norm is not finite is left as it is.
// Lazy: the gradient is int32 in fixed point; where an eight's words are all 0 nothing is touched, moments and average
// included; elsewhere the words are set back to 0. One invocation looks through 8 eights and steps the few that it must
// one after the other: a CPU device runs a branch that no lane takes at nearly the price of one that all take.
// Outer product: the gradient of row r and column k is Σ_i a_i[r] b_i[k], formed here (kernels/optimizer/outer_product.h).
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#include "lib/eight_floats.glsl"
#include "lib/elements.glsl"
#include "shared/optimizer.h"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint lazy = 0;
layout(constant_id = 1) const uint with_norm = 1;  // 0: `norms` is not read, the gradient is taken as it is
layout(constant_id = 2) const uint with_average = 1;
// Lazy: look for words that are not 0 through the texel view. Five times faster on a CPU device, which hands the bits on;
// others may flush small integers, which are denormal floats, to 0.
layout(constant_id = 3) const uint words_as_texels = 0;
layout(constant_id = 4) const uint outer_columns = 0;  // of an outer product, a multiple of 8; 0: the gradient is a range

layout(push_constant, scalar) uniform Constants { AdamConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer old_parameters;
layout(binding = 1, rgba32f) uniform readonly imageBuffer gradients;  // outer product: b
layout(binding = 2, rgba32f) uniform readonly imageBuffer old_first_moments;
layout(binding = 3, rgba32f) uniform readonly imageBuffer old_second_moments;
layout(binding = 4, rgba32f) uniform readonly imageBuffer old_averages;
layout(binding = 5, scalar) readonly buffer Norms { GradientNorm norms[]; };
// The same memory again, to write: an invocation reads what it writes before, and no other does.
layout(binding = 6, scalar) writeonly buffer Parameters { u64vec4 parameters[]; };
layout(binding = 7, scalar) buffer FixedGradients { u64vec4 fixed_gradients[]; };  // lazy: int32; no texels, which are floats
layout(binding = 8, scalar) writeonly buffer FirstMoments { u64vec4 first_moments[]; };
layout(binding = 9, scalar) writeonly buffer SecondMoments { u64vec4 second_moments[]; };
layout(binding = 10, scalar) writeonly buffer Averages { u64vec4 averages[]; };
layout(binding = 11, rgba32f) uniform readonly imageBuffer outer_rows;  // a

void step4(inout vec4 p, vec4 gradient, inout vec4 m, inout vec4 v, inout vec4 average, float scale) {
  vec4 g = scale * gradient + c.weight_decay * p;
  m = c.beta1 * m + c.one_minus_beta1 * g;
  v = c.beta2 * v + c.one_minus_beta2 * g * g;
  p -= c.step_size * m / (sqrt(v * c.inverse_correction2) + c.epsilon);
  average += c.one_minus_average_decay * (p - average);
}

void step8(uint at, EightFloats gradient, float scale, bool store) {
  EightFloats p = EightFloats(imageLoad(old_parameters, 2 * int(at)), imageLoad(old_parameters, 2 * int(at) + 1));
  EightFloats m = EightFloats(imageLoad(old_first_moments, 2 * int(at)), imageLoad(old_first_moments, 2 * int(at) + 1));
  EightFloats v = EightFloats(imageLoad(old_second_moments, 2 * int(at)), imageLoad(old_second_moments, 2 * int(at) + 1));
  EightFloats average = EightFloats(vec4(0.0), vec4(0.0));
  if (with_average != 0u) average = EightFloats(imageLoad(old_averages, 2 * int(at)), imageLoad(old_averages, 2 * int(at) + 1));
  step4(p.low, gradient.low, m.low, v.low, average.low, scale);
  step4(p.high, gradient.high, m.high, v.high, average.high, scale);
  if (store) {
    parameters[at] = pack_eight(p);
    first_moments[at] = pack_eight(m);
    second_moments[at] = pack_eight(v);
    if (with_average != 0u) averages[at] = pack_eight(average);
  }
}

void main() {
  float scale = 1.0;
  bool usable = true;
  if (with_norm != 0u) {
    scale = norms[c.norm_index].scale;
    usable = norms[c.norm_index].usable != 0u;
  }
  uint eights = c.eights;
  if (lazy == 0u) {
    uint at = gl_GlobalInvocationID.x;
    uint within = min(at, eights - 1u);
    if (outer_columns != 0u) {
      uint row = (c.first_eight + within) / (outer_columns / 8u), column = c.first_column + 2u * ((c.first_eight + within) % (outer_columns / 8u));
      EightFloats gradient = EightFloats(vec4(0.0), vec4(0.0));
      for (uint i = 0u; i < c.pairs; ++i) {
        float a = ELEMENT(outer_rows, i * c.row_stride + row);
        gradient.low += a * imageLoad(gradients, int(i * c.column_stride + column));
        gradient.high += a * imageLoad(gradients, int(i * c.column_stride + column) + 1);
      }
      step8(within, gradient, scale, usable && at < eights);
      return;
    }
    step8(within, EightFloats(imageLoad(gradients, 2 * int(within)), imageLoad(gradients, 2 * int(within) + 1)), scale, usable && at < eights);
    return;
  }
  uint first = gl_WorkGroupID.x * (64u * lazy_eights) + gl_LocalInvocationIndex;
  uint touched = 0u;
  [[unroll]] for (uint k = 0u; k < lazy_eights; ++k) {
    uint at = first + 64u * k;
    uint within = min(at, eights - 1u);
    bool any_word;
    if (words_as_texels != 0u) {
      uvec4 low = floatBitsToUint(imageLoad(gradients, 2 * int(within)));
      uvec4 high = floatBitsToUint(imageLoad(gradients, 2 * int(within) + 1));
      any_word = any(notEqual(low | high, uvec4(0u)));
    } else {
      any_word = any(notEqual(fixed_gradients[within], u64vec4(0ul)));
    }
    touched |= any_word && at < eights ? 1u << k : 0u;
  }
  touched = usable ? touched : 0u;
  while (touched != 0u) {
    uint at = first + 64u * uint(findLSB(touched));
    touched &= touched - 1u;
    u64vec4 words = fixed_gradients[at];
    ivec4 low = ivec4(unpackUint2x32(words.x), unpackUint2x32(words.y));
    ivec4 high = ivec4(unpackUint2x32(words.z), unpackUint2x32(words.w));
    step8(at, EightFloats(c.gradient_unit * vec4(low), c.gradient_unit * vec4(high)), scale, true);
    fixed_gradients[at] = u64vec4(0ul);
  }
}
