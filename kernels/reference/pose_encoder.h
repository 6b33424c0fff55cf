// The hierarchical pose encoder in double precision (ARAH.md section 1, "Hierarchical pose encoder"; paper, appendix
// "Canonical SDF Network"): each joint's six numbers come from its rotation, its rest position, the length of its bone
// and its parent's six numbers; the root's parent is a global summary of the whole input.
//   g = W_g p + b_g,   o_j = W2_j relu(W1_j [R_j, J_j, |J_j − J_parent|, o_parent] + b1_j) + b2_j,   code = [o_0 … o_n]
// The root's bone length is |J_0|, its parent's numbers are g.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace arah::reference {

inline constexpr std::size_t kPoseChannels = 12;   // of a joint's input: R row by row, J
inline constexpr std::size_t kPoseFeatures = 6;    // of a joint's output
inline constexpr std::size_t kPoseHidden = kPoseChannels + 1 + kPoseFeatures;

struct PoseEncoder {
  std::vector<int> parents;  // [joints]; −1 for the root, which comes first; parents come before their children
  std::vector<double> global_w, global_b;  // [6][12 joints], [6]: of all rotations, then all positions
  std::vector<double> w1, b1;              // [joints][19][19], [joints][19]
  std::vector<double> w2, b2;              // [joints][6][19], [joints][6]

  std::size_t joints() const { return parents.size(); }
  PoseEncoder zeros() const;  // same tree, every parameter 0
};

struct PoseEncoderTape {
  std::vector<double> inputs;  // [joints][19]
  std::vector<double> hidden;  // [joints][19], after the ReLU
  std::vector<double> code;    // [joints][6]
};

// rotations [joints][9], positions [joints][3] (of the cube). Throws std::invalid_argument when sizes do not fit.
PoseEncoderTape pose_encoder_forward(const PoseEncoder& encoder, std::span<const double> rotations,
                                     std::span<const double> positions);

struct PoseGradient {
  std::vector<double> rotations, positions;
};

// dL/d(rotations, positions); adds the parameter gradients to `gradients` unless it is null. A bone of length 0 passes
// nothing on to positions.
PoseGradient pose_encoder_backward(const PoseEncoder& encoder, std::span<const double> rotations,
                                   std::span<const double> positions, const PoseEncoderTape& tape,
                                   std::span<const double> d_code, PoseEncoder* gradients);

}  // namespace arah::reference
