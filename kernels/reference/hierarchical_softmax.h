// The hierarchical softmax over a tree of joints, forward and backward, in double precision (ARAH.md section 2).
//
// Mass 1 enters at the root and each joint passes on the share sigmoid(gate) to its children, keeping the rest:
//   w_a = m_a (1 - s(gate_a)),   m_c = m_a s(gate_a) softmax_c   for the children c of a,   m_root = 1.
// The softmax runs over the children's own logits; a single child has no softmax, and its own logit is the gate.
//
// Logits: slot j belongs to joint j. Slot 0, which no parent needs, is the gate of the root where the root has several
// children, and is read by nothing otherwise. Every other joint with several children has its gate in a further slot
// after the joints', in joint order. SMPL: 24 joints, splits at the root (slot 0) and at joint 9 (slot 24): 25 logits.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace arah::reference {

class JointTree {
 public:
  static constexpr std::size_t kMostJoints = 64;

  // parents[0] is -1 and 0 <= parents[j] < j for the others; 1 to 64 joints. Throws std::invalid_argument otherwise.
  explicit JointTree(const std::vector<int>& parents);

  std::size_t joints() const { return children_.size(); }
  std::size_t logits() const { return logits_; }
  const std::vector<std::size_t>& children(std::size_t joint) const { return children_[joint]; }
  // The slot of the logit that decides how much a joint with children passes on to them.
  std::size_t gate(std::size_t joint) const { return gates_[joint]; }

 private:
  std::vector<std::vector<std::size_t>> children_;
  std::vector<std::size_t> gates_;
  std::size_t logits_ = 0;
};

// logits [points][tree.logits()], already scaled -> weights [points][joints], which sum to 1. Finite at any finite
// logit.
std::vector<double> hierarchical_softmax_forward(const JointTree& tree, std::size_t points,
                                                 std::span<const double> logits);

// dL/dlogits [points][tree.logits()] from dL/dweights [points][joints]; 0 in a slot that nothing reads.
std::vector<double> hierarchical_softmax_backward(const JointTree& tree, std::size_t points,
                                                  std::span<const double> logits, std::span<const double> d_weights);

}  // namespace arah::reference
