#include "kernels/skinning/joint_tree.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/linear/matrix.h"

namespace arah {
namespace {
constexpr uint32_t no_gate = 255;  // NO_GATE of lib/hierarchical_softmax.glsl
}

JointTree::JointTree(const std::vector<int>& parents) : parents_(parents), joints_(static_cast<uint32_t>(parents.size())) {
  if (parents.empty() || parents.size() > most_joints)
    throw std::invalid_argument(fmt::format("a joint tree has 1 to {} joints, not {}", most_joints, parents.size()));
  std::vector<uint32_t> children(joints_, 0), last_child(joints_, 0);
  for (uint32_t joint = 0; joint < joints_; ++joint) {
    const int parent = parents[joint];
    if (joint == 0 ? parent != -1 : parent < 0 || parent >= static_cast<int>(joint))
      throw std::invalid_argument(fmt::format(
          "joint {} cannot have the parent {}: the root comes first and parents before their children", joint, parent));
    if (joint > 0) {
      ++children[static_cast<uint32_t>(parent)];
      last_child[static_cast<uint32_t>(parent)] = joint;
    }
  }

  logits_ = joints_;
  specialization_.assign(2 + most_joints, no_gate << 8);
  for (uint32_t joint = 0; joint < joints_; ++joint) {
    uint32_t gate = no_gate;
    if (children[joint] == 1) gate = last_child[joint];
    if (children[joint] > 1) gate = joint == 0 ? 0 : logits_++;
    const uint32_t parent = joint == 0 ? 0 : static_cast<uint32_t>(parents[joint]);
    specialization_[2 + joint] = parent | gate << 8;
  }
  specialization_[0] = joints_;
  specialization_[1] = padded_channels(logits_) / channel_padding;
}

}  // namespace arah
