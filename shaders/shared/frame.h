// Constants of one frame: what every kernel that goes between posed and canonical space reads. Valid in C++ and GLSL.
#ifndef ARAH_SHARED_FRAME_H
#define ARAH_SHARED_FRAME_H

#ifdef __cplusplus
#include <cstddef>
#include <cstdint>
namespace arah {
#endif

// n(x) = x · cube_scale + cube_offset (ARAH.md §1): cube_scale = 2 / (1.1 (cmax − cmin)) per metre, one for the three axes.
// bones[3 j + i] is row i of joint j's canonical → posed transform B_j (3 × 4, without the root translation).
#ifdef __cplusplus
struct FrameConstants {
  float cube_offset[3];
  float cube_scale;
  float root_translation[3];  // t, metres, world
  uint32_t joint_count;
  float bones[64 * 3][4];
};
static_assert(offsetof(FrameConstants, root_translation) == 16);
static_assert(offsetof(FrameConstants, bones) == 32);
static_assert(sizeof(FrameConstants) == 32 + 64 * 3 * 16);
}  // namespace arah
#else
struct FrameConstants {
  vec3 cube_offset;
  float cube_scale;
  vec3 root_translation;
  uint joint_count;
  vec4 bones[64 * 3];
};
#endif
#endif
