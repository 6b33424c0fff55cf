// Push constants of shaders/skinning. Valid in C++ and GLSL. Texels are 4 floats, groups 8.
#ifndef ARAH_SHARED_SKINNING_H
#define ARAH_SHARED_SKINNING_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#endif

struct LbsConstants {
  uint row_limit;
  uint logit_stride;  // texels
  uint logit_column;
  uint weight_stride;  // groups
  uint weight_column;
};

struct LbsBackwardConstants {
  uint row_limit;
  uint logit_stride;  // texels
  uint logit_column;
  uint d_logit_stride;  // groups
  uint d_logit_column;
};

struct WeightsLossConstants {
  uint points;
  uint logit_stride;  // texels
  uint logit_column;
  uint d_logit_stride;  // groups
  uint d_logit_column;
  float scale;  // the term's weight / points
};

struct JacobianConstants {
  uvec3 stride;  // of the gradients of x_bar's three components, texels
  uvec3 column;
};

struct ImplicitJointConstants {
  uint rays;
  uint gradient_stride;  // texels
  uint gradient_column;
  uint sdf_stride;  // of the cotangents, texels
  uint sdf_column;
};

// How gradients through a search of roots fared, in numbers of roots.
struct ImplicitCounts {
  uint singular;   // no gradient: J has no inverse in float32
  uint shortened;  // a gradient that grew beyond the bound (kernels/reference/implicit.h, most_amplification)
};

struct BoneGradientConstants {
  uint rows;
  uint weight_stride;  // texels
  uint weight_column;
};

#ifdef __cplusplus
static_assert(sizeof(LbsConstants) == 20);
static_assert(sizeof(LbsBackwardConstants) == 20);
static_assert(sizeof(WeightsLossConstants) == 24);
static_assert(sizeof(JacobianConstants) == 24);
static_assert(sizeof(ImplicitJointConstants) == 20);
static_assert(sizeof(ImplicitCounts) == 8);
static_assert(sizeof(BoneGradientConstants) == 12);
}  // namespace arah::shared
#endif
#endif
