// Where the parts of the colour network's input row lie (kernels/reference/color.h, ARAH.md section 3):
// [n(x) 3 | view encoding 27 if VIEW | normal 3 if NORMAL | SDF feature FEATURE | feature grid, if any | zeros].
// A frame's latent code is constant over a batch and is folded into the bias instead (lib/parameterisation.glsl).
#ifndef ARAH_LIB_COLOR_ROW_GLSL
#define ARAH_LIB_COLOR_ROW_GLSL

layout(constant_id = 0) const int VIEW = 1;
layout(constant_id = 1) const int NORMAL = 1;
layout(constant_id = 2) const int FEATURE = 256;

const int OCTAVES = 4;
const int VIEW_AT = 3;
const int NORMAL_AT = VIEW_AT + VIEW * 3 * (1 + 2 * OCTAVES);
const int FEATURE_AT = NORMAL_AT + 3 * NORMAL;
const int GROUPS_A_BLOCK = 4;  // of 8 columns: what one invocation writes of the feature's columns

#endif
