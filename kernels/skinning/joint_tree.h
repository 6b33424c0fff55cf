// A rig's joint tree as the skinning kernels take it: in specialization constants.
#pragma once

#include <cstdint>
#include <vector>

namespace arah {

// What the hierarchical softmax runs over; the order of the logits is that of kernels/reference/hierarchical_softmax.h.
class JointTree {
 public:
  static constexpr uint32_t most_joints = 64;

  // parents[0] is −1 and 0 ≤ parents[j] < j for the others; 1 to 64 joints. Throws std::invalid_argument otherwise.
  explicit JointTree(const std::vector<int>& parents);

  const std::vector<int>& parents() const { return parents_; }
  uint32_t joints() const { return joints_; }
  uint32_t logits() const { return logits_; }  // outputs of the skinning network
  // Constants 0 to 65 of lib/hierarchical_softmax.glsl.
  const std::vector<uint32_t>& specialization() const { return specialization_; }

 private:
  std::vector<int> parents_;
  uint32_t joints_ = 0;
  uint32_t logits_ = 0;
  std::vector<uint32_t> specialization_;
};

}  // namespace arah
