#include "kernels/reference/hierarchical_softmax.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "tests/kernels/reference/finite_differences.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah::reference {
namespace {

std::vector<int> chain(std::size_t joints) {
  std::vector<int> parents(joints);
  std::iota(parents.begin(), parents.end(), -1);
  return parents;
}

std::vector<int> star(std::size_t joints) {
  std::vector<int> parents(joints, 0);
  parents[0] = -1;
  return parents;
}

std::vector<std::vector<int>> trees() {
  return {
      {-1},  // one joint
      chain(2),
      chain(64),
      star(2),                             // a root with one child
      star(64),                            //
      {-1, 0, 1, 1, 3, 3, 3, 0},           // splits at 0, 1 and 3
      {-1, 0, 1, 1, 2, 2, 4, 4, 4, 8, 3},  // a single child of the root, then splits
      smpl_parents(),
  };
}

TEST(JointTree, NumbersTheLogits) {
  const JointTree smpl(smpl_parents());
  EXPECT_EQ(smpl.logits(), 25u);
  EXPECT_EQ(smpl.gate(0), 0u);
  EXPECT_EQ(smpl.gate(9), 24u);
  EXPECT_EQ(smpl.gate(1), 4u);

  const JointTree late({-1, 0, 1, 1, 2, 2});  // the root has one child; joints 1 and 2 split
  EXPECT_EQ(late.logits(), 8u);
  EXPECT_EQ(late.gate(0), 1u);
  EXPECT_EQ(late.gate(1), 6u);
  EXPECT_EQ(late.gate(2), 7u);
}

TEST(JointTree, RefusesWhatIsNoTree) {
  EXPECT_THROW(JointTree({}), std::invalid_argument);
  EXPECT_THROW(JointTree({0}), std::invalid_argument);
  EXPECT_THROW(JointTree({-1, -1}), std::invalid_argument);
  EXPECT_THROW(JointTree({-1, 1}), std::invalid_argument);
  EXPECT_THROW(JointTree({-1, 2, 0}), std::invalid_argument);
  EXPECT_THROW(JointTree(chain(65)), std::invalid_argument);
}

TEST(HierarchicalSoftmax, FollowsTheGatesOfASmallTree) {
  // 0 splits into 1 and 2; 2 has the child 3
  const JointTree tree({-1, 0, 0, 2});
  const std::vector<double> l = {0.3, -1.1, 0.4, 2.0};
  const auto s = [](double x) { return 1 / (1 + std::exp(-x)); };
  const double first = std::exp(l[1]) / (std::exp(l[1]) + std::exp(l[2]));
  const double passed = s(l[0]);
  const std::vector<double> expected = {1 - passed, passed * first, passed * (1 - first) * (1 - s(l[3])),
                                        passed * (1 - first) * s(l[3])};
  const std::vector<double> weights = hierarchical_softmax_forward(tree, 1, l);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(weights[i], expected[i], 1e-15) << i;
}

TEST(HierarchicalSoftmax, BackwardMatchesFiniteDifferencesOnAnyTree) {
  for (const std::vector<int>& parents : trees()) {
    const JointTree tree(parents);
    const std::size_t points = 3;
    std::vector<double> logits = random_values(points * tree.logits(), 2, 5);
    const std::vector<double> weights = random_values(points * tree.joints(), 1, 6);
    const std::vector<double> gradient = hierarchical_softmax_backward(tree, points, logits, weights);
    if (parents.size() == 1) {
      EXPECT_EQ(gradient, std::vector<double>(points, 0.0));
      continue;
    }
    expect_gradient(
        "softmax over " + std::to_string(parents.size()) + " joints",
        [&] { return dot(weights, hierarchical_softmax_forward(tree, points, logits)); }, logits, gradient, 1e-3);
  }
}

TEST(HierarchicalSoftmax, SumsToOneAtAnyLogit) {
  for (const std::vector<int>& parents : trees()) {
    const JointTree tree(parents);
    for (double scale : {1.0, 50.0, 20 * 1e4, 1e300}) {
      const std::size_t points = 16;
      const std::vector<double> logits = random_values(points * tree.logits(), scale, 7);
      const std::vector<double> weights = hierarchical_softmax_forward(tree, points, logits);
      for (std::size_t p = 0; p < points; ++p) {
        const auto row = weights.begin() + static_cast<std::ptrdiff_t>(p * tree.joints());
        EXPECT_NEAR(std::accumulate(row, row + static_cast<std::ptrdiff_t>(tree.joints()), 0.0), 1, 1e-13) << scale;
      }
      for (double w : weights) EXPECT_TRUE(w >= 0 && w <= 1) << w;
      const std::vector<double> ones(points * tree.joints(), 1.0);
      for (double d : hierarchical_softmax_backward(tree, points, logits, ones)) EXPECT_NEAR(d, 0, 1e-13) << scale;
    }
  }
}

TEST(HierarchicalSoftmax, MatchesTheGoldenCase) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("02_hsoftmax");
  const JointTree tree(smpl_parents());
  const std::size_t points = extent(truth, "in.logits", 0);
  const std::vector<double> logits = truth.values("in.logits"), weights = truth.values("in.G");
  const std::vector<double> output = hierarchical_softmax_forward(tree, points, logits);
  golden::expect_golden(truth, "out.w", output);
  golden::expect_golden(truth, "out.L", dot(weights, output));
  golden::expect_golden(truth, "grad.logits", hierarchical_softmax_backward(tree, points, logits, weights));
}

}  // namespace
}  // namespace arah::reference
