// Push constants of shaders/conditioning, and the pose encoder's sizes. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_CONDITIONING_H
#define ARAH_SHARED_CONDITIONING_H
#ifdef __cplusplus
#include "shaders/shared/glsl_types.h"
namespace arah::shared {
#define ARAH_CONSTANT inline constexpr uint
#else
#define ARAH_CONSTANT const uint
#endif

// The encoder's sizes a joint (kernels/reference/pose_encoder.h).
ARAH_CONSTANT pose_channels = 12;  // R 9, J 3
ARAH_CONSTANT pose_features = 6;
ARAH_CONSTANT pose_hidden = pose_channels + 1 + pose_features;
ARAH_CONSTANT most_joints = 64;
// Rows of a matrix that one workgroup of vector_layer_input_gradient adds up.
ARAH_CONSTANT gradient_rows = 256;
#undef ARAH_CONSTANT

struct PoseEncoderConstants {
  uint joints;
  // Floats from the start of the encoder's parameters, and of their gradients.
  uint global_w, global_b, w1, b1, w2, b2;
};

struct VectorLayerConstants {
  uint rows;            // of one block, or of this launch where there is one block
  uint blocks;          // matrices one below the other, [blocks][rows][columns]
  uint input_stride;    // floats between the inputs of two blocks; 0: all read the same
  uint first_input;     // floats, a multiple of 4
};

struct LayerNormConstants {
  uint size;  // of a block
};

struct LowRankConstants {
  uint outputs, inputs, rank;
  uint h;  // floats from the start of the coefficients, and of their gradients
};

#ifdef __cplusplus
}  // namespace arah::shared
#endif
#endif
