#include "kernels/reference/broyden.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>
#include <vector>

#include "tests/golden.h"
#include "tests/kernels/reference/golden_networks.h"
#include "tests/kernels/reference/matrix_rows.h"

namespace arah::reference {
namespace {

const double kNan = std::numeric_limits<double>::quiet_NaN();

// g(u) = A (u − root) + curvature · |u − root|² (1, …, 1)
template <int D>
struct Bowl {
  Matrix<D> a = identity<D>();
  Vector<D> root{};
  double curvature = 0;
  mutable int evaluations = 0;
  Vector<D> operator()(const Vector<D>& u, Matrix<4>& transform) const {
    ++evaluations;
    Vector<D> offset;
    for (int i = 0; i < D; ++i) offset[i] = u[i] - root[i];
    Vector<D> g = multiply<D>(a, offset);
    for (double& component : g) component += curvature * dot<D>(offset, offset);
    transform = identity<4>();
    transform[0][3] = u[0];
    return g;
  }
};

template <int D>
Matrix<D> random_matrix(std::mt19937& generator, double off_identity) {
  std::normal_distribution<double> normal;
  Matrix<D> m = identity<D>();
  for (auto& r : m)
    for (double& value : r) value += off_identity * normal(generator);
  return m;
}

template <int D>
void solves_random_problems() {
  std::mt19937 generator(D);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 200; ++trial) {
    Bowl<D> bowl{random_matrix<D>(generator, 0.15), {}, 0.3};
    Vector<D> start;
    for (int i = 0; i < D; ++i) {
      bowl.root[i] = normal(generator);
      start[i] = bowl.root[i] + 0.05 * normal(generator);
    }
    const auto result = find_root<D>(start, identity<4>(), identity<D>(), bowl);
    EXPECT_TRUE(result.converged) << trial;
    EXPECT_FALSE(result.diverged);
    EXPECT_EQ(bowl.evaluations, result.iterations + 1);
    Matrix<4> transform;
    EXPECT_EQ(norm<D>(bowl(result.root, transform)), result.residual);
    EXPECT_LT(result.residual, 1e-5);
    EXPECT_EQ(result.transform, transform);  // T of the best iterate, not of the last one
  }
}

TEST(FindRoot, SolvesSmallProblems) {
  solves_random_problems<3>();
  solves_random_problems<4>();
}

TEST(FindRoot, ExactInverseJacobianNeedsOneStep) {
  std::mt19937 generator(1);
  const Bowl<4> bowl{random_matrix<4>(generator, 0.4), {1, -2, 3, 4}, 0};
  // From 10 m away as well: the start is not held against the divergence limit.
  for (double distance : {1e-3, 1.0, 10.0}) {
    const auto result = find_root<4>({1 + distance, -2, 3, 4}, identity<4>(), *inverse<4>(bowl.a), bowl);
    EXPECT_TRUE(result.converged);
    EXPECT_EQ(result.iterations, 1);
  }
}

TEST(FindRoot, StartAtTheRootTakesOneStepAndKeepsTheStart) {
  const Bowl<3> bowl{identity<3>(), {0.1, 0.2, 0.3}, 0};
  Matrix<4> start_transform = identity<4>();
  start_transform[1][3] = 7;
  const auto result = find_root<3>(bowl.root, start_transform, identity<3>(), bowl);
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.iterations, 1);
  EXPECT_EQ(result.root, bowl.root);
  EXPECT_EQ(result.residual, 0);
  EXPECT_EQ(result.transform, start_transform);
}

TEST(FindRoot, SingularJacobiansDivergeAtOnce) {
  Matrix<4> flat = identity<4>();
  flat[2][2] = 0;
  const Bowl<3> bowl{identity<3>(), {0.1, 0, 0}, 0};
  const auto point = find_root<3>({0, 0, 0}, identity<4>(), point_inverse_jacobian(flat), bowl);
  EXPECT_TRUE(point.diverged);
  EXPECT_FALSE(point.converged);
  EXPECT_EQ(point.iterations, 0);
  EXPECT_EQ(point.root, (Vector<3>{0, 0, 0}));
  // A ray along the surface: ∇f ⊥ v and LBS = identity make the 4x4 singular.
  const Matrix<4> h = joint_inverse_jacobian({1, 0, 0}, identity<3>(), {0, 1, 0});
  const auto joint = find_root<4>({0, 0, 0, 0}, identity<4>(), h, Bowl<4>{});
  EXPECT_TRUE(joint.diverged);
  EXPECT_FALSE(joint.converged);  // not even at the root: no derivative could pass through it
}

TEST(FindRoot, NaNNeverConverges) {
  const Bowl<3> bowl{identity<3>(), {0.1, 0, 0}, 0};
  for (double bad : {kNan, std::numeric_limits<double>::infinity()}) {
    const auto start = find_root<3>({0, bad, 0}, identity<4>(), identity<3>(), bowl);
    EXPECT_TRUE(start.diverged);
    EXPECT_FALSE(start.converged);
    EXPECT_EQ(start.iterations, 0);
    Matrix<3> h = identity<3>();
    h[1][2] = bad;
    EXPECT_TRUE(find_root<3>({0, 0, 0}, identity<4>(), h, bowl).diverged);
  }
  // A residual that turns NaN on the way: the best iterate before it is kept.
  int calls = 0;
  const auto later = find_root<3>({0, 0, 0}, identity<4>(), identity<3>(), [&](const Vector<3>&, Matrix<4>&) {
    return ++calls < 3 ? Vector<3>{0.5 / calls, 0, 0} : Vector<3>{kNan, 0, 0};
  });
  EXPECT_TRUE(later.diverged);
  EXPECT_FALSE(later.converged);
  EXPECT_EQ(later.iterations, 2);
  EXPECT_EQ(later.residual, 0.25);
}

TEST(FindRoot, ZeroDenominatorsAndRanklessUpdatesStayFinite) {
  // A residual that does not change: y = 0, so the denominator is its offset alone.
  const auto constant = find_root<3>({0, 0, 0}, identity<4>(), identity<3>(), [](const Vector<3>&, Matrix<4>&) {
    return Vector<3>{0.3, 0, 0};
  });
  EXPECT_FALSE(constant.converged);
  EXPECT_TRUE(all_finite<3>(constant.root));
  // H₀ = 0 never moves.
  const auto still = find_root<3>({0.5, 0, 0}, identity<4>(), Matrix<3>{}, Bowl<3>{});
  EXPECT_FALSE(still.converged || still.diverged);
  EXPECT_EQ(still.iterations, 50);
  EXPECT_EQ(still.root, (Vector<3>{0.5, 0, 0}));
}

TEST(FindRoot, DivergesBeyondOneMetre) {
  // The wrong sign of H₀ steps away from the root: the residual doubles to 1.2 m.
  Matrix<3> h = identity<3>();
  for (int i = 0; i < 3; ++i) h[i][i] = -1;
  const auto result = find_root<3>({0.6, 0, 0}, identity<4>(), h, Bowl<3>{});
  EXPECT_TRUE(result.diverged);
  EXPECT_EQ(result.iterations, 1);
  EXPECT_EQ(result.root, (Vector<3>{0.6, 0, 0}));
}

TEST(FindRoot, NearSingularJacobiansAreNeverTakenForSolved) {
  for (double thin : {1e-3, 1e-6, 1e-9, 1e-12, 1e-15}) {
    Bowl<3> bowl{identity<3>(), {0.1, -0.2, 0.3}, 0.5};
    bowl.a[2][2] = thin;
    const Matrix<3> h = inverse<3>(bowl.a).value_or(not_a_matrix<3>());
    const auto result = find_root<3>({0, 0, 0}, identity<4>(), h, bowl);
    Matrix<4> transform;
    EXPECT_EQ(result.converged, norm<3>(bowl(result.root, transform)) < 1e-5) << thin;
    EXPECT_FALSE(result.converged && result.diverged);
    EXPECT_TRUE(all_finite<3>(result.root) && std::isfinite(result.residual));
  }
}

TEST(HitsSurface, OnlyInsideTheInterval) {
  BroydenResult<4> result;
  result.converged = true;
  result.root[3] = 2;
  EXPECT_TRUE(hits_surface(result, 1, 3));
  EXPECT_TRUE(hits_surface(result, 2, 2));
  EXPECT_FALSE(hits_surface(result, 2.1, 3));
  EXPECT_FALSE(hits_surface(result, 1, 1.9));
  result.converged = false;
  EXPECT_FALSE(hits_surface(result, 1, 3));
}

// What a golden search must agree on, where the float32 and the float64 run of the truth agree themselves.
template <int D>
struct Agreement {
  double root = 0, transform = 0, residual = 0;
  int robust = 0, converged = 0, other_steps = 0;

  void compare(const golden::Case& truth, std::size_t i, const BroydenResult<D>& result, const Vector<D>& root_truth) {
    if (!truth.integers("out.robust")[i]) return;
    ++robust;
    const bool should_converge = truth.integers("out.converged")[i] != 0;
    EXPECT_EQ(result.converged, should_converge) << i;
    EXPECT_FALSE(result.converged && result.diverged) << i;
    if (!should_converge || !result.converged) return;
    ++converged;
    other_steps += result.iterations != truth.integers("out.iters")[i];
    residual = std::max(residual, std::abs(result.residual - truth.values("out.residual")[i]));
    for (int j = 0; j < D; ++j) root = std::max(root, std::abs(result.root[j] - root_truth[j]));
    const Matrix<4> expected = matrix<4>(truth.values("out.T"), i);
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c) transform = std::max(transform, std::abs(result.transform[r][c] - expected[r][c]));
  }

  // Both runs are float64: the same iterates up to what rounding grows to in some 50 steps.
  void expect_same() const {
    std::printf(
        "  %d robust, %d converged, %d with another number of steps; largest error: root %.1e, T %.1e, residual "
        "%.1e m\n",
        robust, converged, other_steps, root, transform, residual);
    EXPECT_EQ(other_steps, 0);
    EXPECT_LT(root, 1e-9);
    EXPECT_LT(transform, 1e-9);
    EXPECT_LT(residual, 1e-9);
  }
};

TEST(FindRoot, Golden07Points) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("07_broyden_points"), lbs("03_lbs_net");
  const SkinningNetwork network = golden_skinning(lbs, lbs);
  const auto bones = truth.values("in.B"), x0 = truth.values("in.x0"), x_bar = truth.values("in.x_bar"),
             t0 = truth.values("in.T0"), roots = truth.values("out.x");
  std::vector<double> first_residuals, inverse_jacobians;
  Agreement<3> agreement;
  for (std::size_t i = 0; i < static_cast<std::size_t>(truth.extent("in.x0", 0)); ++i) {
    const Vector<3> start = row<3>(x0, i), target = row<3>(x_bar, i);
    const auto residual = [&](const Vector<3>& x, Matrix<4>& transform) {
      const SkinningOutput skinned = skinning_forward(network, bones, 1, x);
      transform = matrix<4>(skinned.blended);
      return Vector<3>{skinned.x_bar[0] - target[0], skinned.x_bar[1] - target[1], skinned.x_bar[2] - target[2]};
    };
    Matrix<4> blended;
    append<3>(first_residuals, residual(start, blended));
    const Matrix<3> h = point_inverse_jacobian(blended);
    append<3>(inverse_jacobians, h);
    const auto result = find_root<3>(start, matrix<4>(t0, i), h, residual);
    agreement.compare(truth, i, result, row<3>(roots, i));
  }
  golden::expect_golden(truth, "out.g0", first_residuals);
  golden::expect_golden(truth, "out.H0", inverse_jacobians);
  agreement.expect_same();
  EXPECT_GT(agreement.converged, 150);
}

TEST(FindRoot, Golden07Joint) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("07_broyden_joint"), lbs("03_lbs_net"), sdf("04_siren_full_params");
  const SkinningNetwork network = golden_skinning(lbs, lbs);
  Siren siren = golden_siren(sdf);
  for (SirenLayer& layer : siren.layers) {  // this case has no modulation: γ = 1, η = 0
    std::fill(layer.gamma.begin(), layer.gamma.end(), 1);
    std::fill(layer.eta.begin(), layer.eta.end(), 0);
  }
  const auto bones = truth.values("in.B"), x0 = truth.values("in.x0"), d0 = truth.values("in.d0"),
             directions = truth.values("in.dir"), t0 = truth.values("in.T0"), near_far = truth.values("in.near_far"),
             cam = truth.values("in.cam"), trans = truth.values("in.trans"), roots = truth.values("out.x"),
             depths = truth.values("out.d");
  const auto robust = truth.integers("out.robust"), hit = truth.integers("out.hit");
  std::vector<double> first_residuals, inverse_jacobians;
  Agreement<4> agreement;
  for (std::size_t i = 0; i < static_cast<std::size_t>(truth.extent("in.x0", 0)); ++i) {
    const Vector<3> direction = row<3>(directions, i);
    const Vector<4> start{x0[3 * i], x0[3 * i + 1], x0[3 * i + 2], d0[i]};
    const auto residual = [&](const Vector<4>& u, Matrix<4>& transform) {
      const Vector<3> x{u[0], u[1], u[2]};
      const SkinningOutput skinned = skinning_forward(network, bones, 1, x);
      transform = matrix<4>(skinned.blended);
      Vector<4> g;
      g[0] = siren_forward(siren, 1, network.cube.to_cube(x)).sdf[0] / network.cube.scale();
      for (int c = 0; c < 3; ++c) g[c + 1] = skinned.x_bar[c] - (cam[c] + u[3] * direction[c] - trans[c]);
      return g;
    };
    Matrix<4> blended;
    append<4>(first_residuals, residual(start, blended));
    // The metric gradient per metre is the network's per cube unit: the two scales cancel.
    const Vector<3> x{start[0], start[1], start[2]};
    const SirenOutput field = siren_forward(siren, 1, network.cube.to_cube(x));
    const Matrix<4> h = joint_inverse_jacobian(row<3>(field.gradient, 0),
                                               matrix<3>(skinning_jacobian(network, bones, 1, x)), direction);
    append<4>(inverse_jacobians, h);
    const auto result = find_root<4>(start, matrix<4>(t0, i), h, residual);
    agreement.compare(truth, i, result, {roots[3 * i], roots[3 * i + 1], roots[3 * i + 2], depths[i]});
    if (robust[i]) {
      EXPECT_EQ(hits_surface(result, near_far[2 * i], near_far[2 * i + 1]), hit[i] != 0) << i;
    }
  }
  golden::expect_golden(truth, "out.g0", first_residuals);
  golden::expect_golden(truth, "out.H0", inverse_jacobians);
  agreement.expect_same();
  EXPECT_GT(agreement.converged, 50);
}

}  // namespace
}  // namespace arah::reference
