// The hierarchical pose encoder (reference::pose_encoder_forward; ARAH.md section 1, "Hierarchical pose encoder").
#pragma once

#include "kernels/vulkan/commands.h"
#include "shaders/shared/conditioning.h"

namespace arah {

struct PoseCodeArgs {
  uint32_t joints = 0;  // 1..64
  BufferSlice parents;  // int32 [joints], −1 for the root, which comes first; parents come before their children
  BufferSlice pose;     // float [joints][9] rotations row by row, then [joints][3] rest joints in the cube
  BufferSlice parameters;              // float
  shared::PoseEncoderConstants at{};   // where its tensors lie there and in `gradients`; joints is set here
  BufferSlice inputs, hidden;          // out (=): float [joints][19] each, kept for the way back
  BufferSlice code;                    // out (=): float [joints][6]
};
// Throws std::invalid_argument for a number of joints out of range.
void record_pose_code(Commands& commands, const PoseCodeArgs& args);

struct PoseCodeBackwardArgs {
  PoseCodeArgs forward;
  BufferSlice d_code;     // float [joints][6]
  BufferSlice gradients;  // +=: as `parameters`
  BufferSlice d_pose;     // out (=): as `pose`; a bone of length 0 passes nothing on
};
void record_pose_code_backward(Commands& commands, const PoseCodeBackwardArgs& args);

}  // namespace arah
