#include "kernels/reference/hierarchical_softmax.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "kernels/reference/activation.h"
#include "kernels/reference/sizes.h"

namespace arah::reference {
namespace {

// The softmax over the children of a joint; 1 for a single child.
std::vector<double> shares_of_children(const JointTree& tree, std::size_t joint, std::span<const double> logits) {
  const auto& children = tree.children(joint);
  if (children.size() == 1) return {1.0};
  double largest = -std::numeric_limits<double>::infinity();
  for (std::size_t child : children) largest = std::max(largest, logits[child]);
  std::vector<double> shares;
  double sum = 0;
  for (std::size_t child : children) {
    shares.push_back(std::exp(logits[child] - largest));
    sum += shares.back();
  }
  for (double& share : shares) share /= sum;
  return shares;
}

// The mass m that reaches each joint. Parents come before their children, so one sweep in joint order does it.
std::vector<double> masses(const JointTree& tree, std::span<const double> logits) {
  std::vector<double> mass(tree.joints(), 0.0);
  mass[0] = 1;
  for (std::size_t joint = 0; joint < tree.joints(); ++joint) {
    const auto& children = tree.children(joint);
    if (children.empty()) continue;
    const double passed = mass[joint] * sigmoid(logits[tree.gate(joint)]);
    const std::vector<double> shares = shares_of_children(tree, joint, logits);
    for (std::size_t k = 0; k < children.size(); ++k) mass[children[k]] = passed * shares[k];
  }
  return mass;
}

}  // namespace

JointTree::JointTree(const std::vector<int>& parents) : children_(parents.size()), gates_(parents.size(), 0) {
  if (parents.empty() || parents.size() > kMostJoints) {
    throw std::invalid_argument("a joint tree has 1 to 64 joints, not " + std::to_string(parents.size()));
  }
  for (std::size_t joint = 0; joint < parents.size(); ++joint) {
    const int parent = parents[joint];
    if (joint == 0 ? parent != -1 : parent < 0 || parent >= static_cast<int>(joint)) {
      throw std::invalid_argument("joint " + std::to_string(joint) + " cannot have the parent " +
                                  std::to_string(parent) + ": the root comes first and parents before their children");
    }
    if (joint > 0) children_[static_cast<std::size_t>(parent)].push_back(joint);
  }
  logits_ = parents.size();
  for (std::size_t joint = 0; joint < parents.size(); ++joint) {
    if (children_[joint].size() == 1) gates_[joint] = children_[joint][0];
    if (children_[joint].size() > 1) gates_[joint] = joint == 0 ? 0 : logits_++;
  }
}

std::vector<double> hierarchical_softmax_forward(const JointTree& tree, std::size_t points,
                                                 std::span<const double> logits) {
  check_size("hierarchical softmax: logits", logits.size(), points * tree.logits());
  std::vector<double> weights;
  for (std::size_t p = 0; p < points; ++p) {
    const auto row = logits.subspan(p * tree.logits(), tree.logits());
    const std::vector<double> mass = masses(tree, row);
    for (std::size_t joint = 0; joint < tree.joints(); ++joint) {
      const bool leaf = tree.children(joint).empty();
      weights.push_back(leaf ? mass[joint] : mass[joint] * sigmoid(-row[tree.gate(joint)]));
    }
  }
  return weights;
}

// With d_a = dL/dm_a, and D_a the mean of the children's d under the softmax:
//   d_a = G_a (1 - s) + s D_a,   dL/dgate = m_a s (1 - s) (D_a - G_a),   dL/dlogit_c = m_a s softmax_c (d_c - D_a).
std::vector<double> hierarchical_softmax_backward(const JointTree& tree, std::size_t points,
                                                  std::span<const double> logits, std::span<const double> d_weights) {
  check_size("hierarchical softmax backward: logits", logits.size(), points * tree.logits());
  check_size("hierarchical softmax backward: d_weights", d_weights.size(), points * tree.joints());
  std::vector<double> d_logits(logits.size(), 0.0);
  for (std::size_t p = 0; p < points; ++p) {
    const auto row = logits.subspan(p * tree.logits(), tree.logits());
    const auto d_row = std::span(d_logits).subspan(p * tree.logits(), tree.logits());
    const std::vector<double> mass = masses(tree, row);
    const auto given = d_weights.subspan(p * tree.joints(), tree.joints());
    std::vector<double> d_mass(given.begin(), given.end());
    for (std::size_t joint = tree.joints(); joint-- > 0;) {
      const auto& children = tree.children(joint);
      if (children.empty()) continue;
      const std::vector<double> shares = shares_of_children(tree, joint, row);
      const double passed = sigmoid(row[tree.gate(joint)]), kept = sigmoid(-row[tree.gate(joint)]);
      double mean = 0;
      for (std::size_t k = 0; k < children.size(); ++k) mean += shares[k] * d_mass[children[k]];
      if (children.size() > 1) {
        for (std::size_t k = 0; k < children.size(); ++k) {
          d_row[children[k]] += mass[joint] * passed * shares[k] * (d_mass[children[k]] - mean);
        }
      }
      d_row[tree.gate(joint)] += mass[joint] * passed * kept * (mean - given[joint]);
      d_mass[joint] = given[joint] * kept + passed * mean;
    }
  }
  return d_logits;
}

}  // namespace arah::reference
