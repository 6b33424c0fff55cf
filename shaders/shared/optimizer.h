// What the optimiser's kernels and the host agree on. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_OPTIMIZER_H
#define ARAH_SHARED_OPTIMIZER_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#endif

// One parameter group's gradient in this step.
struct GradientNorm {
  float norm;      // 2-norm before clipping; infinite or NaN where the gradient is
  float scale;     // min(1, max_norm / norm): what Adam multiplies the gradient by; 0 where the norm is not finite
  uint nonfinite;  // how many of its numbers are NaN or infinite
  uint usable;     // 1: the norm is finite; 0: Adam leaves the group as it is
};

// What one workgroup of optimizer/sum_of_squares leaves.
struct SquaresPartial {
  float squares;
  uint nonfinite;
};

// squares_tile: floats that one workgroup of optimizer/sum_of_squares reads, 64 invocations x 64 times x 4.
// lazy_eights: eights that one invocation of a lazy optimizer/adam looks through.
#ifdef __cplusplus
inline constexpr uint squares_tile = 64 * 64 * 4;
inline constexpr uint lazy_eights = 8;
#else
const uint squares_tile = 64 * 64 * 4;
const uint lazy_eights = 8;
#endif

struct SumOfSquaresConstants {
  uint texels;  // numbers / 4
  uint first_partial;
};

struct ClipScaleConstants {
  uint partials;
  uint norm_index;
  float max_norm;  // 0: no limit
};

struct AdamConstants {
  uint eights;  // numbers / 8
  uint norm_index;
  float step_size;  // rate / (1 − β₁ᵗ)
  float beta1;
  float one_minus_beta1;  // given apart: 1 − 0.999 in float32 is off by 5e-5 of itself
  float beta2;
  float one_minus_beta2;
  float inverse_correction2;  // 1 / (1 − β₂ᵗ)
  float epsilon;
  float weight_decay;
  float one_minus_average_decay;
  float gradient_unit;  // lazy: the gradient that 1 of its integers stands for
  // Of an outer product:
  uint first_eight;  // of this launch
  uint pairs;
  uint row_stride;     // floats
  uint first_column;   // texels of 4
  uint column_stride;  // texels of 4
};

struct OuterNormConstants {
  uint row_texels;
  uint row_stride;  // texels, as all here
  uint column_texels;
  uint first_column;
  uint column_stride;
  uint first_partial;
};

#ifdef __cplusplus
static_assert(sizeof(GradientNorm) == 16);
static_assert(sizeof(SquaresPartial) == 8);
static_assert(sizeof(AdamConstants) == 68);
}  // namespace arah::shared
#endif
#endif
