// Rays of pixels and the shell around the posed template, against double precision.
#include <algorithm>
#include <bit>
#include <cmath>

#include "kernels/linear/matrix.h"
#include "kernels/rays/generate.h"
#include "kernels/rays/shell_bins.h"
#include "kernels/sampling/outside_shell.h"
#include "shaders/shared/empty_sample.h"
#include "kernels/reference/tracing.h"
#include "shaders/shared/ray.h"
#include "tests/golden.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

using reference::Vector;

class Rays : public DeviceTest {
 protected:
  // A camera some 3 m before the origin, turned by an odd rotation, whose picture the box fills in part.
  static RayCamera camera() {
    const double a = 0.7, b = -0.3, ca = std::cos(a), sa = std::sin(a), cb = std::cos(b), sb = std::sin(b);
    const double rows[3][3] = {{ca, 0, -sa}, {sb * sa, cb, sb * ca}, {cb * sa, -sb, cb * ca}};
    RayCamera result;
    for (size_t i = 0; i < 3; ++i)
      for (size_t j = 0; j < 3; ++j) result.rotation[3 * i + j] = static_cast<float>(rows[i][j]);
    for (size_t j = 0; j < 3; ++j) result.origin[j] = static_cast<float>(-3 * rows[2][j] + 0.1);
    result.fx = 80;
    result.fy = 90;
    result.cx = 31.5F;
    result.cy = 20.25F;
    return result;
  }
  static Vector<3> wide(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }

  // The truth of one pixel's ray in double precision.
  static Vector<3> direction(const RayCamera& camera, double u, double v) {
    const Vector<3> toward{(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1};
    Vector<3> world{};
    for (size_t j = 0; j < 3; ++j)
      for (size_t i = 0; i < 3; ++i) world[j] += double(camera.rotation[3 * i + j]) * toward[i];
    const double size = std::sqrt(reference::dot<3>(world, world));
    for (double& x : world) x /= size;
    return world;
  }

  std::vector<Ray> generate(GenerateRaysArgs args) {
    Buffer rays = empty("rays", uint64_t(padded_points(args.count)) * sizeof(Ray));
    args.rays = rays.slice();
    record_generate_rays(commands, args);
    commands.submit_and_wait();
    return device.download<Ray>(rays.slice());
  }
};

void expect_ray(const Ray& ray, const RayCamera& camera, const RayBox& box, const Vector<3>& direction) {
  Vector<3> origin, minimum, maximum;
  for (size_t i = 0; i < 3; ++i) {
    origin[i] = camera.origin[i];
    minimum[i] = box.minimum[i];
    maximum[i] = box.maximum[i];
    EXPECT_NEAR(ray.direction[i], direction[i], 3e-7);
    EXPECT_EQ(ray.origin[i], camera.origin[i]);
  }
  const reference::RayInterval truth = reference::intersect_box(origin, direction, minimum, maximum);
  const bool hit = ray.near < ray.far;
  // A ray that grazes an edge may fall on either side in single precision.
  if (!truth.hit && truth.near - truth.far < 1e-5 && hit) return;
  if (truth.hit && truth.far - truth.near < 1e-5 && !hit) return;
  ASSERT_EQ(hit, truth.hit);
  if (!hit) {
    EXPECT_EQ(ray.far, -1);
    return;
  }
  // A direction component c turns an error of 1e-7 in itself into 1e-7 / c of depth.
  EXPECT_NEAR(ray.near, truth.near, 2e-5);
  EXPECT_NEAR(ray.far, truth.far, 2e-5);
}

TEST_F(Rays, OfListedPixelsMeetTheBoxAsInDoublePrecision) {
  for (const uint32_t count : {1u, 63u, 65u, 1000u}) {
    GenerateRaysArgs args;
    args.camera = camera();
    args.box = {{-0.4F, -0.9F, -0.3F}, {0.5F, 0.8F, 0.35F}};
    args.count = count;
    std::vector<uint32_t> pixels(count);
    for (uint32_t& pixel : pixels) pixel = static_cast<uint32_t>(generator() % 64 | (generator() % 48) << 16);
    pixels[0] = 40 | 21u << 16;
    Buffer list = filled("pixels", pixels);
    args.pixels = list.slice();
    const std::vector<Ray> rays = generate(args);
    size_t hits = 0;
    for (uint32_t i = 0; i < count; ++i) {
      expect_ray(rays[i], args.camera, args.box, direction(args.camera, pixels[i] & 0xffff, pixels[i] >> 16));
      hits += rays[i].near < rays[i].far;
    }
    EXPECT_GT(hits, 0u);
    EXPECT_TRUE(count < 60 || hits < count) << "no ray misses: the test shows less than it should";
    for (size_t i = count; i < rays.size(); ++i) EXPECT_LT(rays[i].far, rays[i].near) << "padding row " << i;
  }
}

TEST_F(Rays, OfARectangleFollowItsRows) {
  GenerateRaysArgs args;
  args.camera = camera();
  args.box = {{-0.4F, -0.9F, -0.3F}, {0.5F, 0.8F, 0.35F}};
  args.rectangle = {28, 17, 7};
  args.count = 7 * 11;
  const std::vector<Ray> rays = generate(args);
  for (uint32_t i = 0; i < args.count; ++i)
    expect_ray(rays[i], args.camera, args.box, direction(args.camera, 28 + i % 7, 17 + i / 7));
}

TEST_F(Rays, AlongAnAxisAndFromInsideTheBox) {
  GenerateRaysArgs args;
  args.camera.fx = args.camera.fy = 10;
  args.rectangle = {0, 0, 3};  // pixel (0, 0) looks along +z exactly
  args.count = 3;
  args.box = {{-1, -1, -1}, {1, 1, 2}};
  std::vector<Ray> rays = generate(args);
  EXPECT_EQ(rays[0].near, 0);
  EXPECT_NEAR(rays[0].far, 2, 1e-6);
  args.camera.origin = {1.5F, 0, -4};  // beside the box: parallel to its faces, never inside
  rays = generate(args);
  EXPECT_LT(rays[0].far, rays[0].near);
  args.camera.origin = {0, 0, 4};  // the box lies behind
  rays = generate(args);
  for (const Ray& ray : rays) EXPECT_LT(ray.far, ray.near);
}

TEST_F(Rays, ARectangleWithoutWidthIsRefused) {
  GenerateRaysArgs args;
  args.rectangle.width = 0;
  args.count = 4;
  EXPECT_THROW(generate(args), std::invalid_argument);
}

// A shell grid around a ball, whose signed distance is known.
class Shell : public Rays {
 protected:
  static constexpr double radius = 0.25;
  const ShellGrid grid{{-0.4F, -0.45F, -0.5F}, 0.05F, {17, 19, 23}};

  static Vector<3> node(const ShellGrid& g, uint32_t index) {
    const uint32_t x = index % g.nodes[0], y = index / g.nodes[0] % g.nodes[1], z = index / g.nodes[0] / g.nodes[1];
    return {g.origin[0] + double(g.cell) * x, g.origin[1] + double(g.cell) * y, g.origin[2] + double(g.cell) * z};
  }
  std::vector<float> ball() const {
    std::vector<float> distances(padded_points(node_count(grid)), NAN);
    for (uint32_t i = 0; i < node_count(grid); ++i) {
      const Vector<3> p = node(grid, i);
      distances[i] = static_cast<float>(std::sqrt(reference::dot<3>(p, p)) - radius);
    }
    return distances;
  }
  // Trilinear look-up in double precision; infinite outside.
  static double lookup(const ShellGrid& g, const std::vector<float>& distances, const Vector<3>& p) {
    size_t corner[3];
    double part[3];
    for (size_t i = 0; i < 3; ++i) {
      const double at = (p[i] - g.origin[i]) / g.cell, last = g.nodes[i] - 1.0;
      if (!(at >= 0 && at <= last)) return INFINITY;
      corner[i] = static_cast<size_t>(std::min(at, last - 1));
      part[i] = at - static_cast<double>(corner[i]);
    }
    double sum = 0;
    for (size_t bits = 0; bits < 8; ++bits) {
      double share = 1;
      size_t index = 0;
      for (size_t i = 3; i-- > 0;) {
        const size_t up = bits >> i & 1;
        share *= up ? part[i] : 1 - part[i];
        index = index * g.nodes[i] + corner[i] + up;
      }
      sum += share * distances[index];
    }
    return sum;
  }
};

TEST_F(Shell, AGridHasTwoNodesAnAxisAndAnIndexThatFits) {
  EXPECT_EQ(node_count(grid), 17u * 19 * 23);
  ShellGrid flat = grid;
  flat.nodes[1] = 1;
  EXPECT_THROW(node_count(flat), std::invalid_argument);
  EXPECT_THROW(node_count({{}, 0.05F, {2048, 2048, 512}}), std::invalid_argument);
}

TEST_F(Shell, BinsAreKeptWithinTheShellUpToTheFirstDeepOne) {
  const std::vector<float> distances = ball();
  Buffer d = filled("distances", distances);
  const std::array<float, 3> translation{0.3F, -1.2F, 2.5F};
  for (const uint32_t count : {1u, 63u, 65u, 1000u}) {
    std::vector<Ray> rays(count);
    for (Ray& ray : rays) {
      const auto numbers = uniform(6, -0.4, 0.4);
      Vector<3> target, from{1.5 * numbers[3], 1.5 * numbers[4], -1.2}, direction;
      for (size_t c = 0; c < 3; ++c) target[c] = numbers[c];
      for (size_t c = 0; c < 3; ++c) direction[c] = target[c] - from[c];
      const double size = std::sqrt(reference::dot<3>(direction, direction));
      for (size_t c = 0; c < 3; ++c) {
        ray.origin[c] = static_cast<float>(from[c]) + translation[c];
        ray.direction[c] = static_cast<float>(direction[c] / size);
      }
      ray.near = 0.5F;
      ray.far = generator() % 8 ? 1.9F : -1.0F;
    }
    rays[0].far = 1.9F;
    Buffer r = filled("rays", rays), kept = empty("kept", padded_points(count) * 8),
           counts = empty("kept counts", padded_points(count) * 4);
    ShellBinsArgs args;
    args.count = count;
    args.root_translation = translation;
    args.grid = grid;
    args.rays = r.slice();
    args.distances = d.slice();
    args.kept = kept.slice();
    args.kept_counts = counts.slice();
    record_shell_bins(commands, args);
    commands.submit_and_wait();
    const auto bits = device.download<uint64_t>(kept.slice());
    const auto numbers = device.download<uint32_t>(counts.slice());
    size_t with_bins = 0;
    for (uint32_t i = 0; i < count; ++i) {
      uint64_t truth = 0, doubtful = 0;
      bool walking = rays[i].near < rays[i].far, sure = true;
      for (int bin = 0; bin < 64 && walking; ++bin) {
        const double depth = rays[i].near + (bin + 0.5) * (double(rays[i].far) - rays[i].near) / 64;
        Vector<3> p;
        bool at_border = false;
        for (size_t c = 0; c < 3; ++c) {
          p[c] = double(rays[i].origin[c]) + depth * rays[i].direction[c] - translation[c];
          const double at = (p[c] - grid.origin[c]) / grid.cell;
          at_border |= std::abs(at) < 1e-4 || std::abs(at - grid.nodes[c] + 1) < 1e-4;
        }
        const double sd = lookup(grid, distances, p);
        if (sd < args.outer) truth |= uint64_t(1) << bin;
        if (at_border || std::abs(sd - args.outer) < 1e-5) doubtful |= uint64_t(1) << bin;
        if (std::abs(sd + args.inner) < 1e-5) sure = false;
        walking = !(sd < -args.inner);
      }
      if (!sure) continue;
      ASSERT_EQ(bits[i] & ~doubtful, truth & ~doubtful) << "ray " << i;
      ASSERT_EQ(numbers[i], std::popcount(bits[i]));
      with_bins += truth != 0;
    }
    EXPECT_GT(with_bins, count / 8);
    EXPECT_TRUE(count < 60 || with_bins < count);
    for (size_t i = count; i < bits.size(); ++i) EXPECT_EQ(bits[i], 0u) << "padding";
  }
}

TEST_F(Shell, SamplesOutsideAreMarkedEmpty) {
  const std::vector<float> distances = ball();
  Buffer d = filled("distances", distances);
  const uint32_t rows = 1003;
  std::vector<float> points;
  for (uint32_t row = 0; row < padded_points(rows); ++row) {
    for (const float x : uniform(3, -0.6, 0.6)) points.push_back(x);
    points.push_back(row % 7 == 0 ? 0.0F : 1.0F);
  }
  Buffer p = filled("points", points);
  const float outer = 0.055F;
  record_outside_shell(commands, {rows, grid, outer, d.slice(), p.slice()});
  commands.submit_and_wait();
  const auto marked = device.download<float>(p.slice());
  uint32_t empty_rows = 0, kept_rows = 0;
  for (uint32_t row = 0; row < padded_points(rows); ++row) {
    for (size_t c = 0; c < 3; ++c) EXPECT_EQ(marked[4 * row + c], points[4 * row + c]);
    const double sd = lookup(grid, distances, {points[4 * row], points[4 * row + 1], points[4 * row + 2]});
    if (std::abs(sd - outer) < 1e-5) continue;
    const bool empties = row < rows && points[4 * row + 3] > 0 && sd > outer;
    EXPECT_EQ(marked[4 * row + 3], empties ? shared::EMPTY : points[4 * row + 3]) << row << ": " << sd;
    empty_rows += empties;
    kept_rows += !empties && points[4 * row + 3] > 0;
  }
  EXPECT_GT(empty_rows, 100u);
  EXPECT_GT(kept_rows, 50u);
}

TEST_F(Shell, ARayStraightThroughTheBallStopsInsideIt) {
  Buffer d = filled("distances", ball());
  std::vector<Ray> rays{{{0.01F, 0.01F, -1}, 0.5F, {0, 0, 1}, 1.5F}};
  Buffer r = filled("rays", rays), kept = empty("kept", 64 * 8), counts = empty("kept counts", 64 * 4);
  ShellBinsArgs args;
  args.count = 1;
  args.grid = grid;
  args.rays = r.slice();
  args.distances = d.slice();
  args.kept = kept.slice();
  args.kept_counts = counts.slice();
  record_shell_bins(commands, args);
  commands.submit_and_wait();
  const uint64_t bits = device.download<uint64_t>(kept.slice())[0];
  // The surface is at depth 0.75: from 5.5 cm before it (bin 12 or 13) to 3 cm behind (bin 17 or 18), without a gap.
  const int first = std::countr_zero(bits), last = 63 - std::countl_zero(bits);
  EXPECT_NEAR(first, 12.5, 1);
  EXPECT_NEAR(last, 17.9, 1);
  EXPECT_EQ(std::popcount(bits), last - first + 1);
}

}  // namespace
}  // namespace arah
