// Root searches, rays and rotations at the ends of their ranges.
#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <numbers>

#include "host/body/canonical.h"
#include "host/body/kinematics_gradient.h"
#include "host/body/pose.h"
#include "host/capture/camera.h"
#include "host/input_error.h"
#include "kernels/rays/generate.h"
#include "kernels/reference/broyden.h"
#include "kernels/reference/implicit.h"
#include "kernels/reference/tracing.h"
#include "kernels/skinning/bone_gradient.h"
#include "kernels/skinning/implicit_cotangent.h"
#include "kernels/skinning/implicit_joint_cotangent.h"
#include "kernels/skinning/inverse_blend.h"
#include "kernels/skinning/joint_tree.h"
#include "kernels/skinning/lbs.h"
#include "kernels/tracing/broyden_finish.h"
#include "kernels/tracing/broyden_start.h"
#include "kernels/tracing/broyden_step.h"
#include "shaders/shared/ray.h"
#include "tests/extremes/extremes.h"
#include "tests/extremes/rotations_in_long_double.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

using namespace extremes;
using reference::Matrix;
using reference::Vector;

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();

// What a point search is made to see: g(u), and the transform at the start, whose upper 3x3 is the Jacobian that H₀ inverts.
struct Problem {
  Vector<3> start{};
  Matrix<3> jacobian = reference::identity<3>();
  std::function<Vector<3>(const Vector<3>&)> residual;
};
struct Outcome {
  double status = 0, steps = 0, root_flag = 0, residual = 0;
  Vector<3> root{};
};
constexpr double converged = 2, diverged = 3, exhausted = 4;

class BroydenExtremes : public DeviceTest {
 protected:
  // The host's loop, with the targets at the origin, so that posed points are residuals.
  std::vector<Outcome> solve(const std::vector<Problem>& problems) {
    const uint32_t points = static_cast<uint32_t>(problems.size()), padded = padded_points(points);
    std::vector<float> starts(4 * padded, 0.0F), transforms(12 * padded, 0.0F);
    for (size_t p = 0; p < points; ++p)
      for (size_t i = 0; i < 3; ++i) {
        starts[4 * p + i] = static_cast<float>(problems[p].start[i]);
        for (size_t j = 0; j < 3; ++j) transforms[12 * p + 4 * i + j] = static_cast<float>(problems[p].jacobian[i][j]);
      }
    const std::vector<FrameConstants> constants = {frame_constants({}, {})};
    Buffer frame = filled("frame", constants), start_rows = filled("starts", starts), transform_rows = filled("transforms", transforms), targets = filled("targets", std::vector<float>(4 * padded, 0.0F)),
           posed = empty("posed", 16ull * padded), active = empty("active", 4ull * padded), memory = empty("state", BroydenState::bytes(padded, Unknowns::point, false)), canonical = empty("canonical", 16ull * padded),
           depth = empty("depth", 4ull * padded), counts = filled("counts", std::vector<shared::SearchCounts>(1));
    const BroydenState state{memory.slice(), padded, Unknowns::point, false};
    const Rows rows{{points, {}}, {}};
    const auto evaluate = [&](const BufferSlice& iterates) {
      const std::vector<float> at = device.download<float>(iterates);
      std::vector<float> g(4 * padded, 0.0F);
      for (size_t p = 0; p < points; ++p) {
        const Vector<3> value = problems[p].residual({at[4 * p], at[4 * p + 1], at[4 * p + 2]});
        for (size_t i = 0; i < 3; ++i) g[4 * p + i] = static_cast<float>(value[i]);
      }
      device.upload(posed.slice(), g);
    };
    evaluate(start_rows.slice());
    record_broyden_start(commands, {rows, state, frame.slice(), start_rows.slice(), posed.slice(), transform_rows.slice(), targets.slice(), {}, {}, {}, {}, active.slice()});
    commands.submit_and_wait();
    for (int step = 0; step < 50; ++step) {
      evaluate(state.iterates());
      record_broyden_step(commands, {rows, state, frame.slice(), posed.slice(), {}, targets.slice(), {}, active.slice()});
      commands.submit_and_wait();
    }
    record_broyden_finish(commands, {points, state, {}, targets.slice(), canonical.slice(), depth.slice(), counts.slice()});
    commands.submit_and_wait();
    const std::vector<float> found = device.download<float>(canonical.slice()), status = device.download<float>(state.status());
    std::vector<Outcome> outcomes;
    for (size_t p = 0; p < points; ++p) outcomes.push_back({status[4 * p + 2], status[4 * p + 1], found[4 * p + 3], status[4 * p], {found[4 * p], found[4 * p + 1], found[4 * p + 2]}});
    return outcomes;
  }
};

std::function<Vector<3>(const Vector<3>&)> linear(const Matrix<3>& a, const Vector<3>& root) {
  return [=](const Vector<3>& u) { return reference::multiply<3>(a, {u[0] - root[0], u[1] - root[1], u[2] - root[2]}); };
}
double distance(const Vector<3>& a, const Vector<3>& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }
bool is_finite(const Vector<3>& v) { return reference::all_finite<3>(v); }
bool has_no_root(const Outcome& found) { return found.root_flag == 0 && is_finite(found.root); }

TEST_F(BroydenExtremes, PointSearches) {
  const Matrix<3> one = reference::identity<3>();
  const Vector<3> root{0.1, -0.2, 0.3};
  Matrix<3> flat = one, turned = {{{0.36, 0.48, -0.8}, {-0.8, 0.6, 0}, {0.48, 0.64, 0.6}}};
  flat[2][2] = 0;
  const auto bent = [&](const Vector<3>& u) {  // 0 at `root`, of a slope that grows
    Vector<3> g;
    for (size_t i = 0; i < 3; ++i) g[i] = (u[i] - root[i]) * (1 + 5 * std::abs(u[i] - root[i]));
    return g;
  };
  int calls = 0;
  std::vector<Problem> problems = {
      {{0, 0, 0}, flat, linear(one, root)},                                                             // 0 rank 2
      {{0, 0, 0}, Matrix<3>{}, linear(one, root)},                                                      // 1 rank 0
      {{0, 0, 0}, one, [](const Vector<3>&) { return Vector<3>{0.3, 0, 0}; }},                          // 2 y = 0
      {{0, 0, 0}, one, [](const Vector<3>& u) { return Vector<3>{0.3 + u[1], -u[0], 0}; }},             // 3 vᵀy = 0: the step is turned by a right angle
      {root, one, linear(one, root)},                                                                   // 4 at the root
      {{10.1, -0.2, 0.3}, turned, linear(turned, root)},                                                // 5 10 m away, the Jacobian right
      {{10.1, -0.2, 0.3}, one, bent},                                                                   // 6 10 m away, the Jacobian wrong
      {{not_a_number, 0, 0}, one, linear(one, root)},                                                   // 7
      {{infinity, 0, 0}, one, linear(one, root)},                                                       // 8
      {{0, 0, 0}, one, [&calls](const Vector<3>&) { ++calls; return Vector<3>{calls < 3 ? 0.5 / calls : not_a_number, 0, 0}; }},  // 9
      {{0, 0, 0}, {{{1e-30, 0, 0}, {0, 1e-30, 0}, {0, 0, 1e-30}}}, linear(one, root)},                  // 10 a determinant that underflows
  };
  const size_t thin_first = problems.size();
  const std::vector<double> thins = {1e-3, 1e-6, 1e-9, 1e-12};
  for (const double thin : thins) {
    Matrix<3> a = one;
    a[2][2] = thin;
    problems.push_back({{0, 0, 0}, a, linear(a, root)});
  }
  const std::vector<Outcome> found = solve(problems);
  const auto forward = [](const std::string& what, const std::string& expected, bool came_out) { expect_that(Row::broyden, Way::forward, what, expected, came_out); };
  forward("singular Jacobian of rank 2", "diverged after no step, no root, the start kept", found[0].status == diverged && found[0].steps == 0 && has_no_root(found[0]));
  forward("singular Jacobian of rank 0", "diverged after no step, no root", found[1].status == diverged && found[1].steps == 0 && has_no_root(found[1]));
  forward("a residual that does not change (y = 0): the denominator is its offset alone", "no root, nothing that is not finite", found[2].status != converged && has_no_root(found[2]));
  forward("a step turned by a right angle (vᵀy = 0)", "no root or the right one, nothing that is not finite", is_finite(found[3].root) && (found[3].root_flag == 0 || distance(found[3].root, {0, -0.3, found[3].root[2]}) < 1e-5));
  forward("start at the root", "converged after one step, the start is the root to the bit", found[4].status == converged && found[4].steps == 1 && distance(found[4].root, {double{0.1F}, double{-0.2F}, double{0.3F}}) == 0);
  forward("start 10 m away, the Jacobian right", "converged", found[5].status == converged && found[5].root_flag == 1);
  expect_within(Row::broyden, Way::forward, "start 10 m away, the Jacobian right: root", "distance to the true one, metres", distance(found[5].root, root), 1e-5);
  forward("start 10 m away, the Jacobian wrong, beyond 1 m", "diverged, no root, the start kept", found[6].status == diverged && has_no_root(found[6]));
  forward("NaN start", "diverged after no step, zeros", found[7].status == diverged && found[7].steps == 0 && found[7].root_flag == 0 && distance(found[7].root, {}) == 0);
  forward("infinite start", "diverged after no step, zeros", found[8].status == diverged && found[8].steps == 0 && found[8].root_flag == 0 && distance(found[8].root, {}) == 0);
  forward("a residual that becomes NaN on the way", "diverged, the best iterate before it kept, no root", found[9].status == diverged && has_no_root(found[9]) && found[9].residual == 0.25);
  forward("a Jacobian of 1e-30: its determinant underflows", "diverged after no step, no root", found[10].status == diverged && found[10].steps == 0 && has_no_root(found[10]));
  for (size_t i = 0; i < thins.size(); ++i) {
    const Outcome& one_found = found[thin_first + i];
    const double residual = reference::norm<3>(problems[thin_first + i].residual(one_found.root));
    forward(fmt::format("near-singular Jacobian, least slope {:g}", thins[i]), "a root where the true residual is below 1e-5 m, else none; finite", is_finite(one_found.root) && (one_found.root_flag == 1) == (residual < 1e-5));
  }
}

// The implicit function theorem at Jacobians of all kinds.
TEST_F(BroydenExtremes, GradientsThroughTheSearch) {
  std::vector<Matrix<3>> jacobians;
  const std::vector<double> thins = {1, 1e-2, 1e-4, 1e-5, 1e-8, 1e-12, 0};
  for (const double thin : thins) {
    Matrix<3> j = reference::identity<3>();
    j[2][2] = thin, j[0][1] = 0.5, j[1][2] = -0.25;
    jacobians.push_back(j);
  }
  // Two rows all but parallel: cancellation, and not scale, makes these singular.
  const std::vector<double> aparts = {1e-2, 1e-4, 1e-8, 0};
  for (const double apart : aparts) jacobians.push_back({{{0.6, 0.8, 0}, {0.6, 0.8 + apart, 0}, {0, 0, 1}}});
  jacobians.push_back({{{not_a_number, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  jacobians.push_back({{{infinity, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  const uint32_t points = static_cast<uint32_t>(jacobians.size());
  std::vector<double> rows, upstream;
  for (const auto& j : jacobians) {
    for (const auto& row : j) rows.insert(rows.end(), row.begin(), row.end());
    upstream.insert(upstream.end(), {0.3, -0.7, 0.4});
  }
  Buffer j = filled("jacobians", padded_rows(rows, 3, 4), 64 * 48), above = filled("upstream", padded_rows(upstream, 3, 4)), canonical = filled("canonical", std::vector<float>(4 * 64, 1.0F)), cotangents = empty("cotangents", 64 * 16), counts = filled("counts", std::vector<shared::ImplicitCounts>(1));
  record_implicit_cotangent(commands, {points, j.slice(), above.slice(), canonical.slice(), cotangents.slice(), counts.slice()});
  commands.submit_and_wait();
  const std::vector<double> found = rows_of(device.download<float>(cotangents.slice()), points, 3, 4);
  const auto g = [&](size_t p) { return std::span(found).subspan(3 * p, 3); };
  uint32_t zeros = 0;
  const auto check = [&](size_t p, const std::string& name, bool regular) {
    Matrix<3> rounded = jacobians[p];
    for (auto& row : rounded)
      for (double& value : row) value = static_cast<float>(value);
    if (regular) {
      const Vector<3> truth = reference::implicit_point_gradient(rounded, {double{0.3F}, double{-0.7F}, double{0.4F}}).skinned;
      const std::vector<double> expected = {truth[0], truth[1], truth[2]};
      double lengths = 1;
      for (const auto& row : rounded) lengths *= reference::norm<3>(row);
      const double determinant = std::abs(rounded[0][0] * (rounded[1][1] * rounded[2][2] - rounded[1][2] * rounded[2][1]) - rounded[0][1] * (rounded[1][0] * rounded[2][2] - rounded[1][2] * rounded[2][0]));
      expect_within(Row::broyden, Way::backward, name, "error, of the largest, over |row||row||row| / |det J|", error_of_largest(g(p), expected) / (lengths / determinant), 1e-6);
    } else {
      expect_that(Row::broyden, Way::backward, name, "no gradient, and counted as singular", all_zero(g(p)));
      ++zeros;
    }
  };
  // A short row is no loss of digits; rows that nearly depend on each other are: below 4e-7 of the rows' lengths the determinant
  // is float32's rounding.
  for (size_t i = 0; i < thins.size(); ++i) check(i, fmt::format("Jacobian with a least pivot of {:g}", thins[i]), thins[i] > 0);
  for (size_t i = 0; i < aparts.size(); ++i) check(thins.size() + i, fmt::format("Jacobian with two rows that differ by {:g}", aparts[i]), aparts[i] > 1e-6);
  check(points - 2, "Jacobian with a NaN", false);
  check(points - 1, "Jacobian with an infinity", false);
  double growth = 0;
  for (size_t p = 0; p < points; ++p) growth = std::max(growth, std::hypot(g(p)[0], g(p)[1], g(p)[2]) / std::hypot(0.3, 0.7, 0.4));
  expect_within(Row::broyden, Way::backward, "all these Jacobians", "growth of the gradient, |g| / |dL/dx|", growth, 100.001);
  // As it is however short or long it is itself.
  for (const double size : {1e-30, 1e30}) {
    std::vector<double> scaled;
    for (uint32_t p = 0; p < points; ++p) scaled.insert(scaled.end(), {0.3 * size, -0.7 * size, 0.4 * size});
    Buffer of_size = filled("upstream", padded_rows(scaled, 3, 4)), at_size = empty("cotangents", 64 * 16), counted = filled("counts", std::vector<shared::ImplicitCounts>(1));
    record_implicit_cotangent(commands, {points, j.slice(), of_size.slice(), canonical.slice(), at_size.slice(), counted.slice()});
    commands.submit_and_wait();
    std::vector<double> back = rows_of(device.download<float>(at_size.slice()), points, 3, 4);
    for (double& value : back) value /= size;
    expect_within(Row::broyden, Way::backward, fmt::format("all these Jacobians, dL/dx of {:g}", size), "difference from dL/dx of 1, of the largest", error_of_largest(back, found), 1e-6);
  }
  expect_that(Row::broyden, Way::backward, "the number of singular Jacobians", "that of those above", device.download<shared::ImplicitCounts>(counts.slice())[0].singular == zeros);
}

// Rays that graze the surface, where the joint search's 4x4 Jacobian is singular.
TEST_F(BroydenExtremes, RaysThatGrazeTheSurface) {
  const std::vector<double> angles = {0.5, 1e-2, 1e-4, 1e-8, 0};  // between ray and surface, radians
  const uint32_t count = static_cast<uint32_t>(angles.size());
  std::vector<Ray> rays(64);
  std::vector<double> normals, jacobians, upstream;
  for (size_t r = 0; r < count; ++r) {
    rays[r].direction[0] = static_cast<float>(std::cos(angles[r])), rays[r].direction[1] = static_cast<float>(std::sin(angles[r]));
    rays[r].far = 10;
    normals.insert(normals.end(), {0, 1, 0});
    jacobians.insert(jacobians.end(), {1, 0, 0, 0, 1, 0, 0, 0, 1});
    upstream.insert(upstream.end(), {0.3, -0.7, 0.4, 0.2});
  }
  const std::vector<FrameConstants> constants = {frame_constants({}, {})};
  const uint64_t padded = 64;
  Buffer frame = filled("frame", constants), ray_list = filled("rays", rays), gradients = filled("gradients", padded_rows(normals, 3, 8)), j = filled("jacobians", padded_rows(jacobians, 3, 4), padded * 48), above = filled("upstream", padded_rows(upstream, 4, 4)),
         canonical = filled("canonical", std::vector<float>(4 * padded, 1.0F)), cotangents = empty("cotangents", padded * 16), sdf = empty("sdf", padded * 32), implicit = filled("counts of gradients", std::vector<shared::ImplicitCounts>(1));
  record_implicit_joint_cotangent(commands, {count, frame.slice(), ray_list.slice(), {gradients.slice(), 8, 0}, j.slice(), above.slice(), canonical.slice(), cotangents.slice(), {sdf.slice(), 8, 0}, implicit.slice()});
  // The search itself, from 1 cm in front of the surface y = 0; posed points are canonical ones.
  std::vector<float> starts(4 * padded, 0.0F), depths(4 * padded, 0.0F), transforms(12 * padded, 0.0F);
  for (size_t r = 0; r < count; ++r) starts[4 * r + 1] = 0.01F;
  Buffer start_rows = filled("starts", starts), depth_rows = filled("depths", depths), transform_rows = filled("transforms", transforms), posed = filled("posed", starts), values = empty("values", padded * 32), active = empty("active", padded * 4),
         memory = empty("state", BroydenState::bytes(padded, Unknowns::point_and_depth, false)), depth = empty("depth", padded * 4), counts = filled("counts", std::vector<shared::SearchCounts>(1)), roots = empty("roots", padded * 16);
  const BroydenState state{memory.slice(), padded, Unknowns::point_and_depth, false};
  const RaySurface surface{ray_list.slice(), {values.slice(), 8, 0}};
  const Rows rows{{count, {}}, {}};
  const double metres_per_unit = 1 / reference::Cube{}.scale();
  const auto evaluate = [&](const BufferSlice& iterates) {
    const std::vector<float> at = device.download<float>(iterates);
    std::vector<float> f(8 * padded, 0.0F), q(4 * padded, 0.0F);
    for (size_t r = 0; r < count; ++r) {
      f[8 * r] = static_cast<float>(at[4 * r + 1] / metres_per_unit);
      for (size_t i = 0; i < 3; ++i) q[4 * r + i] = at[4 * r + i];
    }
    device.upload(values.slice(), f);
    device.upload(posed.slice(), q);
  };
  for (Ray& ray : rays) ray.origin[1] = -0.02F;
  device.upload(ray_list.slice(), rays);
  evaluate(start_rows.slice());
  record_broyden_start(commands, {rows, state, frame.slice(), start_rows.slice(), posed.slice(), transform_rows.slice(), {}, surface, depth_rows.slice(), {gradients.slice(), 8, 0}, j.slice(), active.slice()});
  commands.submit_and_wait();
  for (int step = 0; step < 50; ++step) {
    evaluate(state.iterates());
    record_broyden_step(commands, {rows, state, frame.slice(), posed.slice(), {}, {}, surface, active.slice()});
    commands.submit_and_wait();
  }
  record_broyden_finish(commands, {count, state, ray_list.slice(), {}, roots.slice(), depth.slice(), counts.slice()});
  commands.submit_and_wait();
  const std::vector<double> g = rows_of(device.download<float>(cotangents.slice()), count, 3, 4), found = rows_of(device.download<float>(roots.slice()), count, 4, 4), z = rows_of(device.download<float>(depth.slice()), count, 1, 1);
  for (size_t r = 0; r < count; ++r) {
    const std::string name = fmt::format("a ray at {:g} rad to the surface", angles[r]);
    const double hit = 0.02 / std::sin(angles[r]);  // metres along the ray, from 2 cm below the surface
    const bool within = hit < 10;
    if (within) expect_within(Row::broyden, Way::forward, name + ": depth of the hit", "error times the angle, metres", found[4 * r + 3] == 1 ? std::abs(z[r] - hit) * std::sin(angles[r]) : not_a_number, 2e-5);
    else expect_that(Row::broyden, Way::forward, name, "no hit, finite", found[4 * r + 3] == 0 && std::isfinite(found[4 * r]) && std::isfinite(z[r]));
    const auto of_ray = std::span(g).subspan(3 * r, 3);
    if (angles[r] > 1e-5) {
      const auto truth = reference::implicit_joint_gradient(reference::joint_jacobian({0, 1, 0}, reference::identity<3>(), {rays[r].direction[0], rays[r].direction[1], 0}), {double{0.3F}, double{-0.7F}, double{0.4F}, double{0.2F}}, 1);
      expect_within(Row::broyden, Way::backward, name, "error, of the largest, times the angle", error_of_largest(of_ray, truth.skinned) * std::sin(angles[r]), 1e-6);
      expect_within(Row::broyden, Way::backward, name + ": growth", "|g| / |dL/d(x, d)|", std::hypot(of_ray[0], of_ray[1], of_ray[2]) / std::hypot(0.3, 0.7, std::hypot(0.4, 0.2)), 100.001);
    } else {
      expect_that(Row::broyden, Way::backward, name, "no gradient", all_zero(of_ray));
    }
  }
  expect_that(Row::broyden, Way::backward, "the number of grazing rays", "that of those without gradient", device.download<shared::ImplicitCounts>(implicit.slice())[0].singular == 2);
}

class RayExtremes : public DeviceTest {
 protected:
  // The ray of the pixel (u, 0) of a camera without rotation at `origin`.
  Ray ray(const RayBox& box, const std::array<float, 3>& origin, float u = 0, float focal = 1) {
    GenerateRaysArgs args;
    args.camera.origin = origin;
    args.camera.fx = args.camera.fy = focal;
    args.camera.cx = -u;
    args.box = box;
    args.count = 1;
    Buffer rays = empty("rays", 64 * sizeof(Ray));
    args.rays = rays.slice();
    record_generate_rays(commands, args);
    commands.submit_and_wait();
    return device.download<Ray>(rays.slice())[0];
  }
  static bool misses(const Ray& ray) { return ray.near == 0 && ray.far == -1; }
  static double interval_error(const Ray& ray, double near, double far) { return std::max(std::abs(ray.near - near), std::abs(ray.far - far)); }
};

TEST_F(RayExtremes, BoxesAndRaysThatRunAlongThem) {
  const RayBox box{{-1, -1, -1}, {1, 1, 1}};
  const auto within = [](const std::string& what, double error, double bound) { expect_within(Row::box, Way::forward, what, "error of near and far, metres", error, bound); };
  const auto missed = [](const std::string& what, bool came_out) { expect_that(Row::box, Way::forward, what, "no interval", came_out); };
  within("parallel to two faces, between them", interval_error(ray(box, {0.9F, 0, -3}), 2, 4), 1e-6);
  missed("parallel to a face, beside it", misses(ray(box, {1.1F, 0, -3})));
  missed("in the plane of the face at +1: a zero component counts as +1e-12", misses(ray(box, {1, 0, -3})));
  within("in the plane of the face at −1", interval_error(ray(box, {-1, 0, -3}), 2, 4), 1e-6);
  within("parallel but for 1e-9 rad, between faces", interval_error(ray(box, {0.9F, 0, -3}, 1e-9F), 2, 4), 1e-6);
  missed("parallel but for 1e-9 rad, beside the face", misses(ray(box, {1.1F, 0, -3}, 1e-9F)));
  within("10 km away and parallel, 5 cm inside the face", interval_error(ray(box, {0.95F, 0, -1e4F}), 9999, 10001), 2e-3);
  within("10 km away, 1e-6 rad to the face", interval_error(ray(box, {0.95F, 0, -1e4F}, 1e-6F), 9999, 10001), 2e-3);
  within("starting inside the box", interval_error(ray(box, {0, 0, 0.5F}), 0, 0.5), 1e-6);
  within("starting on the far side of the near face", interval_error(ray(box, {0, 0, -1}), 0, 2), 1e-6);
  missed("starting on the far face", misses(ray(box, {0, 0, 1})));
  missed("the box behind", misses(ray(box, {0, 0, 3})));
  missed("a box that is a point", misses(ray({{0, 0, 0}, {0, 0, 0}}, {0, 0, -3})));
  missed("a box without depth along the ray", misses(ray({{-1, -1, 0}, {1, 1, 0}}, {0, 0, -3})));
  missed("a box without width across the ray, beside it", misses(ray({{0.5F, -1, -1}, {0.5F, 1, 1}}, {0, 0, -3})));
  within("a box of 1 mm", interval_error(ray({{-5e-4F, -5e-4F, -5e-4F}, {5e-4F, 5e-4F, 5e-4F}}, {0, 0, -0.01F}), 0.0095, 0.0105), 1e-8);
  within("a box of 1 km", interval_error(ray({{-500, -500, -500}, {500, 500, 500}}, {0, 0, -1000}), 500, 1500), 1e-3);
  missed("a box whose ends are swapped across the ray", misses(ray({{1, 1, 1}, {-1, -1, -1}}, {3, 3, -3})));
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  missed("a box with a NaN", misses(ray({{nan, -1, -1}, {1, 1, 1}}, {0, 0, -3})));
  missed("an infinite box", misses(ray({{-inf, -inf, -inf}, {inf, inf, inf}}, {0, 0, -3})));
  missed("a camera at NaN", misses(ray(box, {0, nan, -3})));
  // Near and far are single precision's: half a unit in the last place of 10 km is half a millimetre.
  for (const auto& [distance, name] : {std::pair{0.01F, "1 cm"}, {1e4F, "10 km"}}) {
    const RayBox body{{-0.5F, -1, 0}, {0.5F, 1, 0.5F}};
    double error = 0;
    for (const float u : {-0.4F, -0.1F, 0.0F, 0.3F}) {
      const Ray found = ray(body, {0.02F, 0.3F, -distance}, u, distance);
      const Vector<3> toward{double{u} / double{distance}, 0, 1};
      const double size = reference::norm<3>(toward);
      const auto truth = reference::intersect_box({double{0.02F}, double{0.3F}, -double{distance}}, {toward[0] / size, 0, toward[2] / size}, {-0.5, -1, 0}, {0.5, 1, 0.5});
      error = std::max(error, (truth.hit ? interval_error(found, truth.near, truth.far) : not_a_number) / (double{distance} + 0.5));
    }
    expect_within(Row::sizes, Way::forward, fmt::format("a camera {} before a body: near and far", name), "error / (distance + 0.5 m)", error, 4e-7);
  }
}

TEST_F(RayExtremes, RowsOfEightThousandPixelsAndOfOne) {
  for (const uint32_t width : {1u, 8192u}) {
    GenerateRaysArgs args;
    args.camera.origin = {0, 0, -3};
    args.camera.fx = args.camera.fy = static_cast<float>(width);
    args.camera.cx = 0.5F * static_cast<float>(width) - 0.5F;
    args.box = {{-0.7F, -1, -0.5F}, {0.7F, 1, 0.5F}};
    args.rectangle = {0, 0, width};
    args.count = width;
    Buffer rays = empty("rays", padded_points(width) * sizeof(Ray));
    args.rays = rays.slice();
    record_generate_rays(commands, args);
    commands.submit_and_wait();
    const std::vector<Ray> found = device.download<Ray>(rays.slice());
    double error = 0;
    for (uint32_t u = 0; u < width; ++u) {
      const double x = (u - (0.5 * width - 0.5)) / width, size = std::hypot(x, 1);
      error = std::max({error, std::abs(found[u].direction[0] - x / size), std::abs(found[u].direction[2] - 1 / size), std::isfinite(found[u].direction[1]) ? 0 : not_a_number});
    }
    expect_within(Row::images, Way::forward, fmt::format("rays of a picture {} wide: directions", width), "error", error, 3e-7);
  }
}

// One bone turns by the angle about an odd axis: what the device makes of a point on it, and what a loss on that point says of the
// rotation, through the bone's matrix in float32.
class RotationExtremes : public DeviceTest {};

TEST_F(RotationExtremes, OnTheDevice) {
  const double pi = std::numbers::pi;
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1, -2, 0.5)), x(0.3, -0.7, 1.1), g(0.4, 0.9, -0.2);
  Skeleton skeleton;
  skeleton.names = {"root"}, skeleton.parents = {-1}, skeleton.rest_joints = {glm::dvec3(0.05, 0.1, -0.2)};
  const CanonicalPose canonical = make_canonical_pose(skeleton);
  for (const auto& [angle, name] : {std::pair{0.0, "0"}, {1e-8, "1e-8"}, {pi - 1e-7, "π − 1e-7"}, {pi, "π"}, {10 * pi, "10 π"}}) {
    Pose pose = rest_pose(skeleton);
    pose.theta[0] = angle * axis;
    const glm::dmat4 bone = bone_transforms(skeleton, canonical, pose).at(0);
    std::vector<double> bones(16);
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c) bones[static_cast<size_t>(4 * r + c)] = bone[c][r];
    const JointTree tree({-1});
    const std::vector<FrameConstants> constants = {frame_constants({}, bones)};
    Buffer frame = filled("frame", constants), logits = filled("logits", std::vector<float>(64 * 8, 0.0F)), points = filled("canonical", padded_rows(std::vector<double>{x.x, x.y, x.z}, 3, 4)), posed = empty("posed", 64 * 16), transforms = empty("transforms", 64 * 48), weights = empty("weights", 64 * 32),
           cotangents = filled("cotangents", padded_rows(std::vector<double>{g.x, g.y, g.z}, 3, 4)), partials = empty("partials", bone_gradient_partials(1, 1)), gradients = filled("dL/dB", std::vector<float>(12, 0.0F));
    const Rows rows{{1, {}}, {}};
    record_lbs(commands, {&tree, rows, {logits.slice(), 8, 0}, frame.slice(), points.slice(), posed.slice(), transforms.slice(), {weights.slice(), 8, 0}});
    BoneGradientArgs back;
    back.rows = rows, back.joints = 1, back.cotangents = cotangents.slice(), back.canonical = points.slice(), back.weights = {weights.slice(), 8, 0}, back.partials = partials.slice(), back.gradients = gradients.slice();
    record_bone_gradient(commands, back);
    commands.submit_and_wait();
    const Exact3x3 rotation = exact_rotation(pose.theta[0]);
    std::vector<double> truth;
    for (int i = 0; i < 3; ++i) {
      long double sum = static_cast<long double>(skeleton.rest_joints[0][i]);
      for (int k = 0; k < 3; ++k) sum += rotation[static_cast<size_t>(i)][static_cast<size_t>(k)] * (static_cast<long double>(x[k]) - skeleton.rest_joints[0][k]);
      truth.push_back(static_cast<double>(sum));
    }
    expect_within(Row::rotations, Way::forward, fmt::format("a bone turned by {}: a posed point", name), "error, metres", largest_error(rows_of(device.download<float>(posed.slice()), 1, 3, 4), truth, 1), 4e-7);
    const std::vector<float> d_bone = device.download<float>(gradients.slice().elements(0, 12));
    glm::dmat4 d_bones(0.0);
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c) d_bones[c][r] = d_bone[static_cast<size_t>(4 * r + c)];
    const KinematicsGradient found = kinematics_gradient(skeleton, canonical, pose, std::vector<glm::dmat4>{d_bones});
    // gᵀ R(θ) (x − J), differentiated in long double.
    const std::array<long double, 3> slope = exact_slope(pose.theta[0], g, x - skeleton.rest_joints[0]);
    double error = 0;
    for (int k = 0; k < 3; ++k) error = std::max(error, static_cast<double>(std::abs(found.theta[0][k] - slope[static_cast<size_t>(k)])));
    expect_within(Row::rotations, Way::backward, fmt::format("a bone turned by {}: dL/d(axis · angle)", name), "error, for forces and arms of 1", std::isfinite(found.theta[0].x + found.theta[0].y + found.theta[0].z) ? error : not_a_number, 4e-7);
  }
}

TEST_F(RotationExtremes, InDoublePrecision) {
  const double pi = std::numbers::pi;
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1, -2, 0.5)), g(0.4, 0.9, -0.2), arm(0.3, -0.7, 1.1);
  for (const auto& [angle, name] : {std::pair{0.0, "0"}, {1e-300, "1e-300"}, {1e-8, "1e-8"}, {pi - 1e-7, "π − 1e-7"}, {pi, "π"}, {10 * pi, "10 π"}}) {
    const glm::dvec3 theta = angle * axis;
    const glm::dmat3 rotation = rotation_from_axis_angle(theta);
    const Exact3x3 truth = exact_rotation(theta);
    double error = 0;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) error = std::max(error, static_cast<double>(std::abs(rotation[c][r] - truth[static_cast<size_t>(r)][static_cast<size_t>(c)])));
    expect_within(Row::rotations, Way::forward, fmt::format("Rodrigues' formula at {}", name), "error of the matrix", error, 4e-15);
    // The angle comes back within [0, π], as the same rotation.
    expect_within(Row::rotations, Way::forward, fmt::format("the axis and angle of the rotation by {}", name), "error of the matrix that they give", [&] {
      const glm::dmat3 again = rotation_from_axis_angle(axis_angle_from_rotation(rotation));
      double largest = 0;
      for (int c = 0; c < 3; ++c) largest = std::max(largest, glm::length(again[c] - rotation[c]));
      return largest;
    }(), 4e-15);
    glm::dmat3 d_rotation;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) d_rotation[c][r] = g[r] * arm[c];
    const glm::dvec3 found = axis_angle_gradient(theta, d_rotation);
    const std::array<long double, 3> slope = exact_slope(theta, g, arm);
    double slope_error = 0;
    for (int k = 0; k < 3; ++k) slope_error = std::max(slope_error, static_cast<double>(std::abs(found[k] - slope[static_cast<size_t>(k)])));
    expect_within(Row::rotations, Way::backward, fmt::format("the slope of Rodrigues' formula at {}", name), "error", std::isfinite(found.x + found.y + found.z) ? slope_error : not_a_number, 1e-14);
  }
}

TEST_F(RotationExtremes, MatricesThatAreNoRotations) {
  Camera camera;
  camera.name = "sheared", camera.width = camera.height = 4;
  camera.R[1][0] = 0.1;
  expect_error<InputError>(Row::rotations, Way::forward, "a camera whose R is sheared by 0.1", {"sheared", "a rotation", "off by"}, [&] { check_camera(camera, "cameras.json"); });
  camera.R = glm::dmat3(1.0);
  camera.R[0][0] = -1;
  expect_error<InputError>(Row::rotations, Way::forward, "a camera whose R is a mirror", {"determinant"}, [&] { check_camera(camera, "cameras.json"); });
  // A rotation that is 1e-7 off, as single precision writes it: its axis and angle are those of a rotation, as near as it is.
  glm::dmat3 rounded = rotation_from_axis_angle({0.5, -1, 2});
  const glm::dmat3 exact = rounded;
  for (int c = 0; c < 3; ++c)
    for (int r = 0; r < 3; ++r) rounded[c][r] += 1e-7 * ((c + 2 * r) % 3 - 1);
  const glm::dmat3 back = rotation_from_axis_angle(axis_angle_from_rotation(rounded));
  double error = 0, orthogonal = 0;
  for (int c = 0; c < 3; ++c) error = std::max(error, glm::length(back[c] - exact[c])), orthogonal = std::max(orthogonal, glm::length((glm::transpose(back) * back - glm::dmat3(1.0))[c]));
  expect_within(Row::rotations, Way::forward, "a matrix 1e-7 off a rotation: its axis and angle", "error of the matrix that they give", error, 4e-7);
  expect_within(Row::rotations, Way::forward, "a matrix 1e-7 off a rotation: its axis and angle", "error of RᵀR of that matrix", orthogonal, 1e-14);
  // On the device blended rotations are none: they shear and shrink, and are inverted as they are.
  const std::vector<double> sheared = {1, 0.5, 0, 0.1, 0, 0.8, 0.2, 0, 0.3, 0, 1.2, -0.1}, collapsed = {1, 0, 0, 0.1, 1, 0, 0, 0, 0, 0, 1, 0};
  std::vector<double> rows = sheared, targets = {0.2, -0.3, 0.4, 1, 0.2, -0.3, 0.4, 1}, canonical_points;
  rows.insert(rows.end(), collapsed.begin(), collapsed.end());
  Buffer transforms = filled("transforms", padded_rows(rows, 12, 12)), target_rows = filled("targets", padded_rows(targets, 4, 4)), canonical = empty("canonical", 64 * 16);
  record_inverse_blend(commands, {2, target_rows.slice(), transforms.slice(), canonical.slice()});
  commands.submit_and_wait();
  const std::vector<double> found = rows_of(device.download<float>(canonical.slice()), 2, 4, 4);
  const Matrix<3> a = {{{1, 0.5, 0}, {0, 0.8, 0.2}, {0.3, 0, 1.2}}};
  const Vector<3> truth = reference::multiply<3>(*reference::inverse<3>(a), {0.1, -0.3, 0.5});
  expect_within(Row::rotations, Way::forward, "a blend that shears: its canonical point", "error, metres", found[3] == 1 ? largest_error(std::span(found).first(3), std::vector<double>(truth.begin(), truth.end()), 1) : not_a_number, 1e-6);
  expect_that(Row::rotations, Way::forward, "a blend that flattens space", "no canonical point: zeros", all_zero(std::span(found).subspan(4, 4)));
}

}  // namespace
}  // namespace arah
