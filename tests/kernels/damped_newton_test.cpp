// Damped Newton searches on the device against their truth in double precision, with a posed body's skinning between the launches.
#include "kernels/tracing/damped_newton.h"

#include "kernels/reference/damped_newton.h"
#include "tests/kernels/posed_body.h"

namespace arah {
namespace {

// x̄ and ∂x̄/∂x of a body by central differences: the network's own derivative has tests elsewhere.
void skinned_with_jacobian(const Body& body, const Vector3& x, Vector3& at, reference::Matrix<3>& jacobian) {
  at = body.skinned(x);
  constexpr double h = 1e-6;
  for (size_t k = 0; k < 3; ++k) {
    Vector3 up = x, down = x;
    up[k] += h;
    down[k] -= h;
    const Vector3 a = body.skinned(up), b = body.skinned(down);
    for (size_t i = 0; i < 3; ++i) jacobian[i][k] = (a[i] - b[i]) / (2 * h);
  }
}

class DampedNewton : public DeviceTest {
 protected:
  struct Found {
    std::vector<float> canonical;  // vec4 by point
    DampedNewtonCounts counts{};
  };

  // The host's loop; evaluate(x, x̄, J) in double, rounded to the device's floats.
  template <class Evaluate>
  Found search(const std::vector<float>& starts, const std::vector<float>& targets, const std::vector<float>& canonical, const std::vector<uint32_t>& listed, int iterations, float tolerance, const Evaluate& evaluate) {
    const auto count = static_cast<uint32_t>(listed.size());
    const uint32_t padded = padded_points(count);
    std::vector<uint32_t> ids = listed;
    ids.resize(padded, listed[0]);
    Buffer id_rows = filled("ids", ids), start_points = filled("starts", starts), target_points = filled("targets", targets), roots = filled("roots", canonical);
    Buffer state = empty("state", padded * damped_newton_state_bytes), trials = empty("trials", padded * 16ull), posed = empty("posed", padded * 16ull), jacobians = empty("jacobians", padded * 48ull);
    Buffer counts = filled("counts", std::vector<uint32_t>(3, 0));
    DampedNewtonArgs args{{{count, {}}, id_rows.slice()}, state.slice(), trials.slice(), start_points.slice(), posed.slice(), jacobians.slice(), target_points.slice(), roots.slice(), counts.slice().sub(0, sizeof(DampedNewtonCounts)), tolerance};
    record_damped_newton_start(commands, args);
    commands.submit_and_wait();
    for (int i = 0; i <= iterations; ++i) {
      const std::vector<float> at = device.download<float>(trials.slice());
      std::vector<float> values(padded * 4, 0), rows(padded * 12, 0);
      for (uint32_t row = 0; row < padded; ++row) {
        Vector3 x_bar{};
        reference::Matrix<3> j{};
        evaluate(Vector3{at[4 * row], at[4 * row + 1], at[4 * row + 2]}, x_bar, j);
        for (size_t k = 0; k < 3; ++k) {
          values[4 * row + k] = static_cast<float>(x_bar[k]);
          for (size_t l = 0; l < 3; ++l) rows[12 * row + 4 * k + l] = static_cast<float>(j[k][l]);
        }
      }
      device.upload(posed.slice(), values);
      device.upload(jacobians.slice(), rows);
      record_damped_newton(commands, args);
      commands.submit_and_wait();
    }
    return {device.download<float>(roots.slice()), device.download<DampedNewtonCounts>(args.counts)[0]};
  }
};

// Far starts in a strongly turned pose: what the truth finds the device finds, at the same place.
TEST_F(DampedNewton, FindWhatTheReferenceFinds) {
  Body body = small_body(generator, 2.0);
  for (double& weight : body.network.layers.layers[1].v) weight *= 60;  // weights that change within centimetres
  constexpr uint32_t points = 200;
  const auto evaluate = [&](const Vector3& x, Vector3& x_bar, reference::Matrix<3>& j) { skinned_with_jacobian(body, x, x_bar, j); };
  std::vector<float> starts, targets, canonical(padded_points(points) * 4, 0);
  std::vector<uint32_t> listed;
  for (uint32_t p = 0; p < padded_points(points); ++p) {
    const std::vector<float> near = uniform(3, -0.6, 0.6), off = uniform(3, -0.5, 0.5);
    const Vector3 at = body.skinned({near[0], near[1], near[2]});
    for (size_t k = 0; k < 3; ++k) {
      starts.push_back(near[k] + off[k]);
      targets.push_back(static_cast<float>(at[k]));
    }
    starts.push_back(0);
    targets.push_back(1);
    if (p % 5 == 4) canonical[4 * p + 3] = 1;  // has a root already
    if (p < points && p % 3 != 2) listed.push_back(p);
  }
  const float tolerance = 1e-4f;
  const Found found = search(starts, targets, canonical, listed, 20, tolerance, evaluate);
  uint32_t roots = 0, both = 0, without_damping = 0;
  double farthest = 0;
  for (const uint32_t p : listed) {
    const float* at = &found.canonical[4 * p];
    if (p % 5 == 4) {
      EXPECT_EQ(at[0], 0) << "was not to be searched";
      continue;
    }
    const Vector3 target{targets[4 * p], targets[4 * p + 1], targets[4 * p + 2]}, start{starts[4 * p], starts[4 * p + 1], starts[4 * p + 2]};
    const auto residual = [&](const Vector3& x, Vector3& g, reference::Matrix<3>& j) {
      evaluate(x, g, j);
      for (size_t k = 0; k < 3; ++k) g[k] -= target[k];
    };
    const reference::DampedNewtonResult truth = reference::find_root_damped(start, residual, {20, double{tolerance}});
    roots += at[3] > 0;
    if (at[3] > 0) {
      const Vector3 g = body.skinned({at[0], at[1], at[2]});
      EXPECT_LT(std::hypot(g[0] - target[0], g[1] - target[1], g[2] - target[2]), tolerance * 1.01);
    }
    if (at[3] > 0 && truth.found) {
      ++both;
      farthest = std::max(farthest, std::hypot(at[0] - truth.root[0], at[1] - truth.root[1], at[2] - truth.root[2]));
    }
    EXPECT_EQ(at[3] > 0, truth.found) << p << ": residual " << truth.residual;
    Vector3 x = start, g{};
    reference::Matrix<3> j{};
    for (int i = 0; i < 20; ++i) {
      residual(x, g, j);
      const Vector3 step = reference::multiply<3>(reference::inverse<3>(j).value_or(reference::not_a_matrix<3>()), g);
      for (size_t k = 0; k < 3; ++k) x[k] -= step[k];
    }
    residual(x, g, j);
    without_damping += reference::norm<3>(g) < double{tolerance};
  }
  std::printf("  %zu searched: %u found (without damping %u), %u by both, %.1e m apart at most, %.1f evaluations each\n", listed.size(), roots, without_damping, both, farthest, double(found.counts.evaluations) / double(listed.size()));
  EXPECT_EQ(found.counts.found, roots);
  EXPECT_GT(both, 80u);
  EXPECT_LT(farthest, 2e-3);  // both within the tolerance, where the map stretches least
}

TEST_F(DampedNewton, StandFoldsAndNumbersThatAreNone) {
  // x̄ = (x², y, z): no root for x̄ < 0, a double one at 0, where J is singular.
  const auto folded = [](const Vector3& x, Vector3& at, reference::Matrix<3>& j) {
    at = {x[0] * x[0], x[1], x[2]};
    j = {};
    j[0][0] = 2 * x[0];
    j[1][1] = j[2][2] = 1;
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> starts{0.5f, 0, 0, 0, 0, 0.3f, 0, 0, 0.5f, 0, 0, 0, nan, 0, 0, 0, 10, 0, 0, 0};
  std::vector<float> targets{0, 0.1f, 0, 1, 1, 0, 0, 1, -0.5f, 0, 0, 1, 0, 0, 0, 1, 0.25f, 5, -5, 1};
  std::vector<float> padded_starts = starts, canonical(256, 0);
  padded_starts.resize(256, 0);
  targets.resize(256, 0);
  const Found found = search(padded_starts, targets, canonical, {0, 1, 2, 3, 4}, 40, 1e-5f, folded);
  EXPECT_EQ(found.canonical[3], 1) << "a double root is found, slowly";
  EXPECT_LT(std::abs(found.canonical[0]), 4e-3) << "x² below 1e-5";
  EXPECT_EQ(found.canonical[7], 0) << "started on the fold itself: the slope of |g| is 0 there";
  EXPECT_EQ(found.canonical[11], 0) << "there is no root";
  EXPECT_EQ(found.canonical[15], 0) << "a start that is not finite";
  EXPECT_EQ(found.canonical[19], 1) << "ten metres away";
  EXPECT_NEAR(found.canonical[16], 0.5, 1e-4);
  EXPECT_EQ(found.counts.found, 2u);
  // After the end nothing is evaluated: not 41 for each.
  EXPECT_LT(found.counts.evaluations, 120u);
}

TEST_F(DampedNewton, MarkWhatHasNoRoot) {
  std::vector<float> targets(4 * 64, 0), canonical(4 * 64, 0);
  targets[3] = 1, targets[7] = 1, canonical[7] = 1, targets[11] = -1, targets[15] = 0;
  Buffer wanted = filled("targets", targets), roots = filled("roots", canonical), flags = filled("flags", std::vector<uint32_t>(64, 9));
  record_mark_unsolved(commands, {5, wanted.slice(), roots.slice(), flags.slice()});
  commands.submit_and_wait();
  const std::vector<uint32_t> marked = device.download<uint32_t>(flags.slice());
  EXPECT_EQ(marked[0], 1u);
  for (size_t p = 1; p < 64; ++p) EXPECT_EQ(marked[p], 0u) << p;
}

}  // namespace
}  // namespace arah
