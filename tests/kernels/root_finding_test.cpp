// Root searches on the device, chained through their buffers as a renderer chains them, with the
// networks evaluated by the double-precision reference between the launches. The reference's own searches are the
// truth.
#include <algorithm>
#include <limits>

#include "kernels/reference/broyden.h"
#include "kernels/reference/siren.h"
#include "kernels/skinning/lbs.h"
#include "kernels/tracing/broyden_finish.h"
#include "kernels/tracing/broyden_start.h"
#include "kernels/tracing/broyden_step.h"
#include "kernels/tracing/compact.h"
#include "tests/golden.h"
#include "tests/kernels/posed_body.h"
#include "tests/kernels/reference/golden_networks.h"

namespace arah {
namespace {

using Vector4 = reference::Vector<4>;

class RootFinding : public DeviceTest {
 protected:
  struct Solved {
    std::vector<double> roots;  // [points][3]
    std::vector<double> root_flags;
    std::vector<double> depths;
    std::vector<double> residuals, steps, status;
    std::vector<double> transforms;  // [points][12]
    shared::SearchCounts counts{};
  };

  // The host's loop. `rays` makes it the joint search. Rows are compacted after each step of an even number only.
  Solved solve(const Body& body, const std::vector<double>& starts, const std::vector<double>& targets,
               const std::vector<Ray>& rays = {}, const std::vector<double>& depths = {},
               const std::vector<double>& root_translation = {0, 0, 0}, const std::vector<uint32_t>& chosen = {},
               float start_tolerance = 0, const std::vector<float>& given = {}) {
    const bool joint = !rays.empty();
    const Unknowns unknowns = joint ? Unknowns::point_and_depth : Unknowns::point;
    const uint32_t points = static_cast<uint32_t>(starts.size() / 3), padded = padded_points(points),
                   width = body.tree.logits(), stride = padded_channels(width);
    FrameConstants constants = frame_constants(body.network.cube, body.bones);
    for (size_t i = 0; i < 3; ++i) constants.root_translation[i] = static_cast<float>(root_translation[i]);
    Buffer frame = filled("frame", std::vector<FrameConstants>{constants});
    Buffer start_rows = filled("starts", padded_rows(starts, 3, 4)),
           target_rows = filled("targets", joint ? std::vector<float>(4) : padded_rows(targets, 3, 4));
    std::vector<Ray> padded_rays = rays;
    padded_rays.resize(padded);
    Buffer ray_rows = filled("rays", padded_rays),
           depth_rows = filled("depths", joint ? padded_rows(depths, 1, 4) : std::vector<float>(4));
    Buffer logit_rows = empty("logits", padded * 4ull * stride), posed = empty("posed", padded * 16ull),
           transforms = empty("transforms", padded * 48ull);
    Buffer weights = empty("weights", padded * 96ull);  // the variant of the pipeline that the skinning tests use
    Buffer sdf = empty("sdf", padded * 32ull), gradients = empty("gradients", padded * 32ull),
           jacobians = empty("jacobians", padded * 48ull);
    Buffer active = empty("active", padded * 4ull), scratch = empty("scratch", compact_blocks(points) * 4ull);
    Buffer ids[2] = {empty("ids 0", padded * 4ull), empty("ids 1", padded * 4ull)};
    Buffer work[2] = {empty("work 0", sizeof(WorkCount)), empty("work 1", sizeof(WorkCount))};
    Buffer state_memory = filled(
        "state", std::vector<float>(BroydenState::bytes(padded, unknowns, true) / 4, 1.0f));  // "active" everywhere
    Buffer canonical = empty("canonical", padded * 16ull), depth = empty("depth", padded * 4ull);
    Buffer counts = filled("counts", std::vector<shared::SearchCounts>(1));
    const BroydenState state{state_memory.slice(), padded, unknowns, true};
    const RaySurface surface{ray_rows.slice(), {sdf.slice(), 8, 0}};

    Rows rows{{points, {}}, {}};
    uint32_t current = 0, row_count = points;
    std::vector<uint32_t> list;
    if (!chosen.empty()) {
      list = chosen;
      row_count = static_cast<uint32_t>(list.size());
      list.resize(padded_points(row_count), list[0]);
      device.upload(ids[0].slice(), list);
      device.upload(work[0].slice(), std::vector<WorkCount>{work_of(row_count)});
      rows = {{points, work[0].slice()}, ids[0].slice()};
    }
    // Networks at the iterates of the rows' points: evaluated by the reference.
    const auto evaluate = [&](const BufferSlice& iterates, bool with_gradients) {
      const std::vector<float> x_all = device.download<float>(iterates);
      std::vector<double> x, values, slopes, jacobian;
      for (uint32_t r = 0; r < row_count; ++r) {
        const uint32_t p = rows.ids.empty() ? r : list[r];
        const Vector3 at{x_all[4 * p], x_all[4 * p + 1], x_all[4 * p + 2]};
        x.insert(x.end(), at.begin(), at.end());
        const reference::Vec3 n = body.network.cube.to_cube(at);
        values.push_back(body.surface.value(n));
        for (const double g : body.surface.gradient(n)) slopes.push_back(g);
      }
      device.upload(logit_rows.slice(), padded_rows(body.logits(x), width, stride));
      if (joint) device.upload(sdf.slice(), padded_rows(values, 1, 8));
      if (joint && with_gradients) {
        device.upload(gradients.slice(), padded_rows(slopes, 3, 8));
        device.upload(jacobians.slice(),
                      padded_rows(reference::skinning_jacobian(body.network, body.bones, row_count, x), 3, 4));
      }
      record_lbs(commands, {&body.tree,
                            rows,
                            {logit_rows.slice(), stride, 0},
                            frame.slice(),
                            iterates,
                            posed.slice(),
                            transforms.slice(),
                            {weights.slice(), 24, 0}});
    };

    evaluate(start_rows.slice(), true);
    record_broyden_start(commands, {rows,
                                    state,
                                    frame.slice(),
                                    start_rows.slice(),
                                    posed.slice(),
                                    transforms.slice(),
                                    target_rows.slice(),
                                    surface,
                                    depth_rows.slice(),
                                    {gradients.slice(), 8, 0},
                                    jacobians.slice(),
                                    active.slice(),
                                    50,
                                    start_tolerance});
    for (int iteration = 0; iteration <= 50; ++iteration) {
      if (iteration % 2 == 0) {
        const uint32_t next = 1 - current;
        record_compact(commands, {rows, active.slice(), {}, scratch.slice(), ids[next].slice(), work[next].slice()});
        commands.submit_and_wait();
        rows = {{points, work[next].slice()}, ids[next].slice()};
        current = next;
        list = device.download<uint32_t>(ids[next].slice());
        row_count = device.download<WorkCount>(work[next].slice().sub(0, sizeof(WorkCount)))[0].count;
      } else {
        commands.submit_and_wait();
      }
      if (row_count == 0 || iteration == 50) break;
      evaluate(state.iterates(), false);
      record_broyden_step(commands, {rows, state, frame.slice(), posed.slice(), transforms.slice(), target_rows.slice(),
                                     surface, active.slice()});
    }
    Buffer given_rows;
    if (!given.empty()) given_rows = filled("given", given);
    record_broyden_finish(commands, {points, state, ray_rows.slice(), target_rows.slice(), canonical.slice(), depth.slice(), counts.slice(),
                                     given.empty() ? BufferSlice{} : given_rows.slice()});
    commands.submit_and_wait();

    Solved solved;
    const std::vector<float> found = device.download<float>(canonical.slice()),
                             status = device.download<float>(state.status());
    solved.roots = rows_of(found, points, 3, 4);
    solved.root_flags = rows_of(found, points, 1, 4, 3);
    solved.residuals = rows_of(status, points, 1, 4, 0);
    solved.steps = rows_of(status, points, 1, 4, 1);
    solved.status = rows_of(status, points, 1, 4, 2);
    solved.transforms = rows_of(device.download<float>(state.transforms()), points, 12, 12);
    if (joint) solved.depths = rows_of(device.download<float>(depth.slice()), points, 1, 1);
    solved.counts = device.download<shared::SearchCounts>(counts.slice().sub(0, sizeof(shared::SearchCounts)))[0];
    return solved;
  }

  // Equal iteration counts, outcomes and roots. Where float32's rounding of the residual (some 3e-7 m) decides whether
  // one more step is taken, the count may differ: such points are counted and few.
  template <int D>
  void expect_same(const Solved& solved, const std::vector<reference::BroydenResult<D>>& truths, double limit) {
    size_t same = 0, roots = 0;
    double largest = 0;
    shared::SearchCounts expected{};
    for (size_t p = 0; p < truths.size(); ++p) {
      const auto& truth = truths[p];
      same += solved.steps[p] == truth.iterations;
      const double outcome = truth.converged ? 2 : truth.diverged ? 3 : 4;
      expected.steps += static_cast<uint32_t>(solved.steps[p]);
      expected.converged += solved.status[p] == 2;
      expected.diverged += solved.status[p] == 3;
      expected.exhausted += solved.status[p] == 4;
      if (!truth.converged) {
        EXPECT_EQ(solved.root_flags[p], 0) << p;
        EXPECT_EQ(solved.status[p], outcome)
            << p << " after " << truth.iterations << " steps, residual " << truth.residual;
        continue;
      }
      ++roots;
      EXPECT_EQ(solved.status[p], 2) << p << " after " << truth.iterations << " steps, residual "
                                     << solved.residuals[p];
      for (size_t i = 0; i < 3; ++i) largest = std::max(largest, std::abs(solved.roots[3 * p + i] - truth.root[i]));
      if (D == 4) largest = std::max(largest, std::abs(solved.depths[p] - truth.root[D - 1]));
      for (size_t i = 0; i < 12; ++i)
        EXPECT_NEAR(solved.transforms[12 * p + i], truth.transform[i / 4][i % 4], 1e-5) << p << ", " << i;
    }
    std::printf("  %zu points, %zu roots, %zu with the same number of steps, largest difference of a root %.2e m\n",
                truths.size(), roots, same, largest);
    EXPECT_LE(largest, limit);
    EXPECT_GE(static_cast<double>(same), 0.97 * static_cast<double>(truths.size()));
    EXPECT_EQ(solved.counts.steps, expected.steps);
    EXPECT_EQ(solved.counts.converged, expected.converged);
    EXPECT_EQ(solved.counts.diverged, expected.diverged);
    EXPECT_EQ(solved.counts.exhausted, expected.exhausted);
  }

  std::vector<reference::BroydenResult<3>> truth_of(const Body& body, const std::vector<double>& starts,
                                                    const std::vector<double>& targets) {
    std::vector<reference::BroydenResult<3>> results;
    for (size_t p = 0; p < starts.size() / 3; ++p) {
      const Vector3 start{starts[3 * p], starts[3 * p + 1], starts[3 * p + 2]};
      const auto residual = [&](const Vector3& x, reference::Matrix<4>& transform) {
        transform = body.transform(x);
        Vector3 g = reference::transform_point(transform, x);
        for (size_t i = 0; i < 3; ++i) g[i] -= targets[3 * p + i];
        return g;
      };
      const reference::Matrix<4> transform = body.transform(start);
      results.push_back(
          reference::find_root<3>(start, transform, reference::point_inverse_jacobian(transform), residual));
    }
    return results;
  }
};

TEST_F(RootFinding, CorrespondencesTakeTheReferencesSteps) {
  const Body body = small_body(generator, 0.9);
  const uint32_t points = 333;
  std::vector<double> starts, targets;
  for (uint32_t p = 0; p < points; ++p) {
    const std::vector<float> at = uniform(3, -0.7, 0.7), off = uniform(3, -0.05, 0.05);
    const double away = p % 50 == 7 ? 100 : 1;  // some targets are out of reach
    const Vector3 posed = body.skinned({at[0], at[1], at[2]});
    for (size_t i = 0; i < 3; ++i) starts.push_back(static_cast<float>(at[i] + off[i]));
    for (size_t i = 0; i < 3; ++i) targets.push_back(static_cast<float>(away * posed[i]));
  }
  starts[3 * 200] = std::numeric_limits<double>::quiet_NaN();
  const auto truths = truth_of(body, starts, targets);
  const Solved solved = solve(body, starts, targets);
  expect_same<3>(solved, truths, 2e-6);
  EXPECT_EQ(solved.status[200], 3);
  EXPECT_EQ(solved.steps[200], 0);
  EXPECT_EQ(solved.roots[600], 0);
  EXPECT_GT(solved.counts.converged, 300u);
}

TEST_F(RootFinding, PointsThatWereNotStartedHaveNoRoot) {
  const Body body = small_body(generator, 0.5);
  std::vector<double> starts, targets;
  for (uint32_t p = 0; p < 200; ++p) {
    const std::vector<float> at = uniform(3, -0.7, 0.7);
    const Vector3 posed = body.skinned({at[0], at[1], at[2]});
    for (size_t i = 0; i < 3; ++i) starts.push_back(static_cast<float>(at[i] + 0.01)), targets.push_back(posed[i]);
  }
  const Solved solved = solve(body, starts, targets, {}, {}, {0, 0, 0}, {3, 4, 150, 199});
  for (uint32_t p = 0; p < 200; ++p) {
    const bool started = p == 3 || p == 4 || p == 150 || p == 199;
    EXPECT_EQ(solved.status[p], started ? 2 : 0) << p;
    EXPECT_EQ(solved.root_flags[p], started ? 1 : 0) << p;
    if (!started) {
      EXPECT_EQ(solved.roots[3 * p], 0) << p;
    }
  }
  EXPECT_EQ(solved.counts.converged, 4u);
  EXPECT_EQ(solved.counts.diverged + solved.counts.exhausted, 0u);
}

TEST_F(RootFinding, AStartThatIsGoodEnoughIsTheRootAndAGivenOneNeedsNoSearch) {
  const Body body = small_body(generator, 0.5);
  const uint32_t points = 200;
  std::vector<double> starts, targets;
  std::vector<float> given(padded_points(points) * 4, 0.0f);
  std::vector<uint32_t> searched;
  for (uint32_t p = 0; p < points; ++p) {
    const std::vector<float> at = uniform(3, -0.7, 0.7);
    const Vector3 posed = body.skinned({at[0], at[1], at[2]});
    const double off = p % 2 ? 0.02 : 2e-5;
    for (size_t i = 0; i < 3; ++i) starts.push_back(static_cast<float>(at[i] + off)), targets.push_back(posed[i]);
    if (p % 5) searched.push_back(p);
    else given[4 * p] = static_cast<float>(p), given[4 * p + 3] = 1;
  }
  const Solved solved = solve(body, starts, targets, {}, {}, {0, 0, 0}, searched, 1e-3f, given);
  for (uint32_t p = 0; p < points; ++p) {
    EXPECT_EQ(solved.root_flags[p], 1) << p;
    if (p % 5 == 0) {
      EXPECT_EQ(solved.roots[3 * p], p);
      EXPECT_EQ(solved.status[p], 0) << "nothing was started";
    } else if (p % 2 == 0) {
      EXPECT_EQ(solved.steps[p], 0) << p;
      for (size_t i = 0; i < 3; ++i) EXPECT_EQ(solved.roots[3 * p + i], starts[3 * p + i]) << p;
    } else {
      EXPECT_GT(solved.steps[p], 0) << p;
    }
  }
  EXPECT_EQ(solved.counts.converged, points);
}

TEST_F(RootFinding, GoldenCorrespondences) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("07_broyden_points"), network("03_lbs_net");
  const Body body{reference::golden_skinning(network, network), truth.values("in.B")};
  const Solved solved = solve(body, truth.values("in.x0"), truth.values("in.x_bar"));
  const std::vector<double> x = truth.values("out.x"), steps = truth.values("out.iters"),
                            robust = truth.values("out.robust"), converged = truth.values("out.converged");
  size_t compared = 0, same_steps = 0;
  double largest = 0;
  for (size_t p = 0; p < robust.size(); ++p) {
    if (robust[p] == 0) continue;
    EXPECT_EQ(solved.root_flags[p], converged[p]) << p;
    if (converged[p] == 0) continue;
    ++compared;
    same_steps += solved.steps[p] == steps[p];
    for (size_t i = 0; i < 3; ++i) largest = std::max(largest, std::abs(solved.roots[3 * p + i] - x[3 * p + i]));
  }
  std::printf("  %zu golden roots, %zu with the same number of steps, largest difference %.2e m\n", compared,
              same_steps, largest);
  EXPECT_GT(compared, 100u);
  EXPECT_LE(largest, 5e-5);  // the golden file's own bound for a robust point
  EXPECT_GE(static_cast<double>(same_steps), 0.9 * static_cast<double>(compared));
}

TEST_F(RootFinding, GoldenSurfacePoints) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("07_broyden_joint"), network("03_lbs_net"), sdf("04_siren_full_params");
  reference::Siren siren = reference::golden_siren(sdf);
  for (reference::SirenLayer& layer : siren.layers) {  // this case has no modulation: γ = 1, η = 0
    std::fill(layer.gamma.begin(), layer.gamma.end(), 1);
    std::fill(layer.eta.begin(), layer.eta.end(), 0);
  }
  const Body body{reference::golden_skinning(network, network),
                  truth.values("in.B"),
                  {[&](const Vector3& n) { return reference::siren_forward(siren, 1, n).sdf[0]; },
                   [&](const Vector3& n) {
                     const std::vector<double> gradient = reference::siren_forward(siren, 1, n).gradient;
                     return Vector3{gradient[0], gradient[1], gradient[2]};
                   }}};
  const std::vector<double> camera = truth.values("in.cam"), directions = truth.values("in.dir"), near_far = truth.values("in.near_far"), x = truth.values("out.x"), depths = truth.values("out.d"),
                            steps = truth.values("out.iters"), robust = truth.values("out.robust"), converged = truth.values("out.converged"), hit = truth.values("out.hit");
  std::vector<Ray> rays(depths.size());
  for (size_t r = 0; r < rays.size(); ++r) {
    for (size_t i = 0; i < 3; ++i) rays[r].origin[i] = static_cast<float>(camera[i]), rays[r].direction[i] = static_cast<float>(directions[3 * r + i]);
    rays[r].near = static_cast<float>(near_far[2 * r]), rays[r].far = static_cast<float>(near_far[2 * r + 1]);
  }
  const Solved solved = solve(body, truth.values("in.x0"), {}, rays, truth.values("in.d0"), truth.values("in.trans"));
  size_t compared = 0, same_steps = 0;
  double largest = 0;
  for (size_t r = 0; r < rays.size(); ++r) {
    if (robust[r] == 0) continue;
    EXPECT_EQ(solved.status[r] == 2, converged[r] != 0) << r;
    EXPECT_EQ(solved.root_flags[r], hit[r]) << r;
    if (converged[r] == 0) continue;
    ++compared;
    same_steps += solved.steps[r] == steps[r];
    for (size_t i = 0; i < 3; ++i) largest = std::max(largest, std::abs(solved.roots[3 * r + i] - x[3 * r + i]));
    largest = std::max(largest, std::abs(solved.depths[r] - depths[r]));
  }
  std::printf("  %zu golden surface points, %zu with the same number of steps, largest difference %.2e m\n", compared, same_steps, largest);
  EXPECT_GT(compared, 50u);
  EXPECT_LE(largest, 5e-5);  // the golden file's own bound for a robust ray
  EXPECT_GE(static_cast<double>(same_steps), 0.9 * static_cast<double>(compared));
}

TEST_F(RootFinding, JointSearchTakesTheReferencesSteps) {
  const Body body = small_body(generator, 0.3);
  const uint32_t count = 130;
  RayScene scene = rays_at(body, generator, count);
  std::vector<double> starts, depths;
  std::vector<reference::BroydenResult<4>> truths;
  uint32_t hits = 0;
  for (uint32_t r = 0; r < count; ++r) {
    const Ray& ray = scene.rays[r];
    const Vector3 direction{ray.direction[0], ray.direction[1], ray.direction[2]};
    const auto along = [&](double depth) {
      Vector3 q;
      for (size_t i = 0; i < 3; ++i) q[i] = double(ray.origin[i]) + depth * direction[i] - scene.root_translation[i];
      return q;
    };
    // Start: near the place where the ray enters a ball about the body, carried over with the blend at the middle.
    const double depth = static_cast<float>(2.45 + 0.05 * uniform(1)[0]);
    const reference::Matrix<4> middle = body.transform(body.network.cube.from_cube({0, 0, 0}));
    Vector3 start = reference::transform_point(*reference::inverse<4>(middle), along(depth));
    for (double& value : start) value = static_cast<float>(value);
    starts.insert(starts.end(), start.begin(), start.end());
    depths.push_back(depth);
    const auto residual = [&](const Vector4& u, reference::Matrix<4>& transform) {
      const Vector3 x{u[0], u[1], u[2]}, q = along(u[3]);
      transform = body.transform(x);
      const Vector3 posed = reference::transform_point(transform, x);
      return Vector4{body.sdf_metric(x), posed[0] - q[0], posed[1] - q[1], posed[2] - q[2]};
    };
    const std::vector<double> jacobian = reference::skinning_jacobian(body.network, body.bones, 1, start);
    reference::Matrix<3> j;
    for (size_t i = 0; i < 9; ++i) j[i / 3][i % 3] = jacobian[i];
    const Vector3 gradient = body.surface.gradient(body.network.cube.to_cube(start));
    truths.push_back(reference::find_root<4>({start[0], start[1], start[2], depth}, body.transform(start),
                                             reference::joint_inverse_jacobian(gradient, j, direction), residual));
    if (r % 9 == 0 && truths.back().converged)
      scene.rays[r].far = static_cast<float>(truths.back().root[3]) - 0.1f;  // no hit: behind the end
    hits += reference::hits_surface(truths.back(), scene.rays[r].near, scene.rays[r].far);
  }
  const Solved solved = solve(body, starts, {}, scene.rays, depths, scene.root_translation);
  expect_same<4>(solved, truths, 5e-6);
  for (uint32_t r = 0; r < count; ++r)
    EXPECT_EQ(solved.root_flags[r], reference::hits_surface(truths[r], scene.rays[r].near, scene.rays[r].far) ? 1 : 0)
        << r;
  EXPECT_EQ(solved.counts.hits, hits);
  EXPECT_GT(hits, 50u);
  EXPECT_LT(hits, solved.counts.converged);
}

}  // namespace
}  // namespace arah
