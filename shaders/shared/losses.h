// Push constants of shaders/losses. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_LOSSES_H
#define ARAH_SHARED_LOSSES_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#endif

struct ImageLossConstants {
  uint rays;
  float inverse_normaliser;  // 1 / N
  float color_weight;
  float alpha_weight;
};

struct EikonalConstants {
  uint points;
  float inverse_normaliser;
  float weight;
  uint stride;  // texels of 4 floats, of the gradient
  uint column;
  uint d_stride;  // texels, of what is written
  uint d_column;
  uint d_texels;
};

struct NormalLossConstants {
  uint points;
  float inverse_normaliser;
  float weight;
  uint stride;  // texels of 4 floats, of the gradient
  uint column;
  uint d_stride;  // texels, of what is added to
  uint d_column;
};

struct SdfPenaltyConstants {
  uint points;
  float inverse_normaliser;
  float weight;
  uint stride;  // floats, of the sdf
  uint column;
  uint d_stride;  // floats, multiples of 4, of its gradient
  uint d_column;
};

struct ParameterNormConstants {
  uint numbers;  // of this tensor
  float inverse_count;  // 1 / numbers of all
  float weight;
  uint first;  // 1: adds the value to the losses
  uint slot;
};

struct MaskLossConstants {
  uint rays;
  float inverse_normaliser;  // 1 / N
  float weight;
  float alpha;
  uint stride;  // texels of 4 floats, of the sdf
  uint column;
  uint d_stride;  // texels, of its gradient
  uint d_column;
};

#ifdef __cplusplus
static_assert(sizeof(ImageLossConstants) == 16);
static_assert(sizeof(EikonalConstants) == 32);
static_assert(sizeof(NormalLossConstants) == 28);
static_assert(sizeof(SdfPenaltyConstants) == 28);
static_assert(sizeof(MaskLossConstants) == 32);
}  // namespace arah::shared
#endif
#endif
