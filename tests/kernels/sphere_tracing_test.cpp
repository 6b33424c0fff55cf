// Sphere tracing on the device, an iteration a launch, with the sdf evaluated by the reference between the launches.
#include <limits>

#include "kernels/reference/tracing.h"
#include "kernels/tracing/compact.h"
#include "kernels/tracing/sphere_step.h"
#include "tests/kernels/posed_body.h"

namespace arah {
namespace {

// Which part of a ray is followed.
enum class Part { in_box, to_end_of_shell, in_shell };
class SphereTracingTest : public DeviceTest, public testing::WithParamInterface<Part> {};

INSTANTIATE_TEST_SUITE_P(Parts, SphereTracingTest, testing::Values(Part::in_box, Part::to_end_of_shell, Part::in_shell), [](const auto& test) {
  return test.param == Part::in_box ? "InBox" : test.param == Part::in_shell ? "InShell" : "ToEndOfShell";
});

TEST_P(SphereTracingTest, FollowsTheReference) {
  const Body body = small_body(generator, 0.3);
  const uint32_t count = 200, padded = padded_points(count);
  RayScene scene = rays_at(body, generator, count);
  scene.rays[5].far = scene.rays[5].near;  // misses the box
  scene.rays[6].far = 1.0f;
  FrameConstants constants = frame_constants(body.network.cube, body.bones);
  for (size_t i = 0; i < 3; ++i) constants.root_translation[i] = static_cast<float>(scene.root_translation[i]);
  // The way to canonical space is one rigid transform here; the search for the nearest vertex has its own tests.
  const reference::Matrix<4> back = *reference::inverse<4>(body.transform(body.network.cube.from_cube({0, 0, 0})));
  const auto f = [&](const Vector3& posed) {
    return body.surface.value(body.network.cube.to_cube(reference::transform_point(back, posed)));
  };

  std::vector<Ray> padded_rays = scene.rays;
  padded_rays.resize(padded);
  Buffer frame = filled("frame", std::vector<FrameConstants>{constants}), rays = filled("rays", padded_rays),
         trace = empty("trace", padded * 16);
  Buffer posed = empty("posed", padded * 16), candidates = empty("candidates", padded * 4),
         active = empty("active", padded * 4), scratch = empty("scratch", 4);
  Buffer ids[2] = {empty("ids 0", padded * 4), empty("ids 1", padded * 4)},
         work[2] = {empty("work 0", 16), empty("work 1", 16)}, sdf = empty("sdf", padded * 32);
  // Any bins: the first and the last count. Ray 9 has none, and is not followed.
  const bool by_shell = GetParam() != Part::in_box;
  std::vector<std::array<uint32_t, 2>> bins(padded, {0, 0});
  std::vector<double> begins, ends;
  for (uint32_t r = 0; r < count; ++r) {
    const uint32_t last = generator() % 64, first = generator() % (last / 2 + 1);
    const double near = scene.rays[r].near, far = scene.rays[r].far;
    begins.push_back(GetParam() == Part::in_shell ? near + first * (far - near) / 64 : near);
    ends.push_back(by_shell ? near + (last + 1) * (far - near) / 64 : far);
    if (r == 9) continue;
    const uint64_t between = ((1ull << last) - 1) & ~((1ull << first) - 1), bits = 1ull << last | 1ull << first | (generator() & between);
    bins[r] = {static_cast<uint32_t>(bits), static_cast<uint32_t>(bits >> 32)};
  }
  Buffer kept = filled("kept bins", bins);
  const SphereTracing tracing{frame.slice(), rays.slice(), by_shell ? kept.slice() : BufferSlice{}, GetParam() == Part::in_shell, trace.slice(), posed.slice(), candidates.slice(), active.slice()};
  Rows rows{{count, {}}, {}};
  record_sphere_start(commands, rows, tracing);
  for (uint32_t iteration = 0; iteration < 50; ++iteration) {
    const uint32_t next = iteration % 2;
    record_compact(commands, {rows, active.slice(), {}, scratch.slice(), ids[next].slice(), work[next].slice()});
    commands.submit_and_wait();
    rows = {{count, work[next].slice()}, ids[next].slice()};
    const uint32_t row_count = device.download<WorkCount>(work[next].slice().sub(0, 16))[0].count;
    if (row_count == 0) break;
    const std::vector<uint32_t> list = device.download<uint32_t>(ids[next].slice());
    const std::vector<float> q = device.download<float>(posed.slice());
    std::vector<double> values;
    for (uint32_t r = 0; r < row_count; ++r) {
      const uint32_t ray = list[r];
      values.push_back(ray == 8 && iteration == 2 ? std::numeric_limits<double>::quiet_NaN()
                                                  : f({q[4 * ray], q[4 * ray + 1], q[4 * ray + 2]}));
    }
    device.upload(sdf.slice(), padded_rows(values, 1, 8));
    record_sphere_step(commands, {rows, tracing, {sdf.slice(), 8, 0}});
  }
  commands.submit_and_wait();

  const std::vector<float> found = device.download<float>(trace.slice());
  const std::vector<uint32_t> candidate = device.download<uint32_t>(candidates.slice());
  std::vector<double> depths, expected;
  uint32_t on_surface = 0, diverged = 0;
  for (uint32_t r = 0; r < count; ++r) {
    const Ray& ray = scene.rays[r];
    Vector3 origin, direction{ray.direction[0], ray.direction[1], ray.direction[2]};
    for (size_t i = 0; i < 3; ++i) origin[i] = ray.origin[i] - scene.root_translation[i];
    if (r == 8 || r == 5 || r == 6 || (r == 9 && by_shell)) {
      EXPECT_EQ(found[4 * r + 3], 2) << r;
      EXPECT_EQ(candidate[r], 0u);
      continue;
    }
    const auto truth = reference::trace_sphere(
        origin, direction, begins[r], ends[r],
        [&](const Vector3& q) {
          return reference::Correspondence{q, {}, 0};
        },
        [&](const Vector3& q) { return f(q) / body.network.cube.scale(); });
    on_surface += truth.on_surface;
    diverged += truth.diverged;
    EXPECT_EQ(candidate[r], truth.diverged ? 0u : 1u) << r;
    EXPECT_EQ(found[4 * r + 3], truth.diverged ? 2 : truth.on_surface ? 1 : 0) << r;
    EXPECT_NEAR(found[4 * r + 2], truth.evaluations, 1) << r;
    depths.push_back(found[4 * r]);
    expected.push_back(truth.depth);
  }
  std::printf("  %u rays on the surface, %u past it\n", on_surface, diverged);
  EXPECT_GT(on_surface, by_shell ? 20u : 50u);
  EXPECT_GT(diverged, 20u);
  expect_all_near("depths of sphere tracing", depths, expected, 3e-5);
}

}  // namespace
}  // namespace arah
