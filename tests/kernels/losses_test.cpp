// Losses on the device, values and gradients, against double precision and the golden tensors.
#include "kernels/reference/losses.h"

#include <cmath>

#include "kernels/losses/eikonal.h"
#include "kernels/losses/image.h"
#include "kernels/losses/mask.h"
#include "kernels/losses/normal.h"
#include "kernels/losses/sdf_penalty.h"
#include "kernels/reduction/sum.h"
#include "tests/golden.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

struct Outcome {
  double value = 0, second = 0;
  std::vector<double> gradient;
};

class Losses : public DeviceTest {
 protected:
  Buffer slots = empty("losses", 256);

  void SetUp() override { device.upload(slots.slice(), std::vector<float>(64, 2.0F)); }
  // What was added to slot i; the neighbours hold what they held.
  double added(size_t i) { return device.download<float>(slots.slice())[i] - 2.0; }

  // colors, targets: 4 a ray. The gradient has 4 a ray.
  Outcome image(const std::vector<float>& colors, const std::vector<float>& targets, float normaliser,
                float color_weight, float alpha_weight, const std::vector<float>& weights = {}) {
    SetUp();
    const uint32_t rays = static_cast<uint32_t>(colors.size() / 4);
    Buffer c = filled("colours", colors), t = filled("targets", targets),
           d = filled("d colours", std::vector<float>(4 * padded_points(rays), NAN)),
           partials = empty("partials", std::max<uint64_t>(partial_bytes(rays, 2), 256));
    Buffer w = filled("ray weights", weights.empty() ? std::vector<float>(1, NAN) : weights);
    record_image_loss(commands, {rays, normaliser, color_weight, alpha_weight, c.slice(), t.slice(), d.slice(),
                                 slots.slice(), 3, partials.slice(), weights.empty() ? BufferSlice{} : w.slice()});
    commands.submit_and_wait();
    EXPECT_EQ(added(2), 0);
    EXPECT_EQ(added(5), 0);
    return {added(3), added(4), gradient(d, rays, 4, 0, 4, 4)};
  }
  Outcome eikonal(const std::vector<std::array<double, 3>>& gradients, float normaliser, float weight) {
    SetUp();
    const uint32_t points = static_cast<uint32_t>(gradients.size());
    std::vector<float> rows(16 * padded_points(points), NAN);
    for (size_t i = 0; i < points; ++i)
      for (size_t c = 0; c < 3; ++c) rows[16 * i + 8 + c] = static_cast<float>(gradients[i][c]);
    Buffer g = filled("gradients", rows),
           d = filled("d gradients", std::vector<float>(16 * padded_points(points), NAN)),
           partials = empty("partials", std::max<uint64_t>(partial_bytes(points), 256));
    record_eikonal_loss(
        commands,
        {points, normaliser, weight, {g.slice(), 16, 8}, {d.slice(), 16, 8}, 8, slots.slice(), 3, partials.slice()});
    commands.submit_and_wait();
    return {added(3), 0, gradient(d, points, 16, 8, 3, 8)};
  }
  Outcome penalty(SdfPenalty kind, const std::vector<double>& sdf, float normaliser, float weight) {
    SetUp();
    const uint32_t points = static_cast<uint32_t>(sdf.size());
    std::vector<float> rows(16 * points, NAN);
    for (size_t i = 0; i < points; ++i) rows[16 * i + 8] = static_cast<float>(sdf[i]);
    Buffer f = filled("sdf", rows), d = filled("d sdf", std::vector<float>(16 * padded_points(points), NAN)),
           partials = empty("partials", std::max<uint64_t>(partial_bytes(points), 256));
    record_sdf_penalty(commands, {kind,
                                  points,
                                  normaliser,
                                  weight,
                                  {f.slice(), 16, 8},
                                  {d.slice(), 16, 8},
                                  8,
                                  slots.slice(),
                                  3,
                                  partials.slice()});
    commands.submit_and_wait();
    return {added(3), 0, gradient(d, points, 16, 8, 1, 8)};
  }

  // with_distance: which rays have one.
  Outcome mask(const std::vector<double>& sdf, const std::vector<float>& masks, const std::vector<bool>& with_distance, float normaliser, float weight, float alpha, const std::vector<float>& weights) {
    SetUp();
    const uint32_t rays = static_cast<uint32_t>(sdf.size());
    std::vector<float> rows(16 * rays, NAN), points(4 * rays, 1.0F);
    for (size_t i = 0; i < rays; ++i) rows[16 * i + 8] = static_cast<float>(sdf[i]), points[4 * i + 3] = with_distance[i] ? 1.0F : 0.0F;
    Buffer f = filled("sdf", rows), p = filled("points", points), m = filled("masks", masks), d = filled("d sdf", std::vector<float>(16 * padded_points(rays), NAN)),
           partials = empty("partials", std::max<uint64_t>(partial_bytes(rays, 2), 256)), w = filled("ray weights", weights.empty() ? std::vector<float>(1, NAN) : weights);
    record_mask_loss(commands, {rays, normaliser, weight, alpha, {f.slice(), 16, 8}, p.slice(), m.slice(), {d.slice(), 16, 8}, 8, slots.slice(), 3, partials.slice(), weights.empty() ? BufferSlice{} : w.slice()});
    commands.submit_and_wait();
    EXPECT_EQ(added(2), 0);
    EXPECT_EQ(added(5), 0);
    return {added(3), added(4), gradient(d, rays, 16, 8, 1, 8)};
  }

  // Added to a gradient that holds `before` everywhere.
  Outcome normal(const std::vector<std::array<double, 3>>& gradients, const std::vector<std::array<double, 3>>& normals, float normaliser, float weight, float before) {
    SetUp();
    const uint32_t points = static_cast<uint32_t>(gradients.size());
    std::vector<float> rows(16 * padded_points(points), NAN), outward(4 * points, NAN), d_rows(16 * padded_points(points), before);
    for (size_t i = 0; i < points; ++i)
      for (size_t c = 0; c < 3; ++c) {
        rows[16 * i + 8 + c] = static_cast<float>(gradients[i][c]);
        outward[4 * i + c] = static_cast<float>(normals[i][c]);
      }
    Buffer g = filled("gradients", rows), n = filled("normals", outward), d = filled("d gradients", d_rows), partials = empty("partials", std::max<uint64_t>(partial_bytes(points), 256));
    record_normal_loss(commands, {points, normaliser, weight, {g.slice(), 16, 8}, n.slice(), {d.slice(), 16, 8}, slots.slice(), 3, partials.slice()});
    commands.submit_and_wait();
    const auto all = device.download<float>(d.slice());
    std::vector<double> change;
    for (size_t row = 0; row < padded_points(points); ++row)
      for (size_t c = 0; c < 16; ++c) {
        const float value = all[16 * row + c];
        if (row < points && c >= 8 && c < 11) change.push_back(double(value) - double(before));
        else EXPECT_EQ(value, before) << "row " << row << " column " << c;
      }
    return {added(3), 0, change};
  }

 private:
  // `used` numbers of each row; the others up to `written`, and the padding rows, must be 0.
  std::vector<double> gradient(Buffer& buffer, uint32_t rows, uint32_t stride, uint32_t column, uint32_t used,
                               uint32_t written) {
    const auto all = device.download<float>(buffer.slice());
    std::vector<double> result;
    for (uint32_t row = 0; row < padded_points(rows); ++row)
      for (uint32_t c = 0; c < written; ++c) {
        const float value = all[size_t(row) * stride + column + c];
        if (row < rows && c < used)
          result.push_back(value);
        else
          EXPECT_EQ(value, 0) << "row " << row << " column " << c;
      }
    return result;
  }
};

double largest(const std::vector<double>& values) {
  double scale = 0;
  for (double x : values) scale = std::max(scale, std::abs(x));
  return scale;
}

TEST_F(Losses, OfTheImageFollowTheReference) {
  for (const uint32_t rays : {1u, 63u, 65u, 1000u}) {
    std::vector<float> colors = uniform(4 * rays, 0, 1), targets = uniform(4 * rays, 0, 1);
    for (uint32_t i = 0; i < rays; ++i) {
      if (i % 7 == 3) targets[4 * i + 3] = -1;            // not in the loss
      if (i % 5 == 2) colors[4 * i + 3] = i % 2 ? 1 : 0;  // held by the clamp
      if (i % 5 == 4) colors[4 * i + 3] = 0.99899F;
      if (i % 11 == 6) colors[4 * i] = targets[4 * i];
    }
    const float normaliser = 77, color_weight = 30, alpha_weight = 2.5F;
    std::vector<reference::Rgb> rendered(rays), photograph(rays);
    std::vector<uint8_t> counts(rays);
    const std::vector<float> ray_weights = uniform(rays, 0.1, 2);
    std::vector<double> sums, masks, weights, weights_of_masks;
    for (uint32_t i = 0; i < rays; ++i) {
      for (size_t c = 0; c < 3; ++c) {
        rendered[i][c] = colors[4 * i + c];
        photograph[i][c] = targets[4 * i + c];
      }
      weights.push_back(ray_weights[i]);
      counts[i] = targets[4 * i + 3] >= 0;
      if (!counts[i]) continue;
      sums.push_back(colors[4 * i + 3]);
      masks.push_back(targets[4 * i + 3]);
      weights_of_masks.push_back(ray_weights[i]);
    }
    const std::vector<double> none;
    for (const bool weighted : {false, true}) {
      const auto color = reference::color_loss(rendered, photograph, counts, normaliser, weighted ? weights : none);
      const auto alpha = reference::alpha_loss(sums, masks, normaliser, weighted ? weights_of_masks : none);
      std::vector<double> truth;
      for (uint32_t i = 0, of_alpha = 0; i < rays; ++i) {
        for (size_t c = 0; c < 3; ++c) truth.push_back(color_weight * color.gradient[i][c]);
        truth.push_back(counts[i] ? alpha_weight * alpha.gradient[of_alpha++] : 0);
      }
      const Outcome actual = image(colors, targets, normaliser, color_weight, alpha_weight, weighted ? ray_weights : std::vector<float>{});
      EXPECT_NEAR(actual.value, color.value, 1e-6 * std::max(1.0, color.value));
      EXPECT_NEAR(actual.second, alpha.value, 1e-6 * std::max(1.0, alpha.value));
      golden::expect_close("d colour and alpha of " + std::to_string(rays) + (weighted ? ", weighted" : ""), actual.gradient, truth,
                           2e-6 * std::max(1.0, largest(truth)));
    }
    // A weight of 1 is none, to the last bit.
    const Outcome plain = image(colors, targets, normaliser, color_weight, alpha_weight), ones = image(colors, targets, normaliser, color_weight, alpha_weight, std::vector<float>(rays, 1.0F));
    EXPECT_EQ(plain.value, ones.value);
    EXPECT_EQ(plain.second, ones.second);
    EXPECT_EQ(plain.gradient, ones.gradient);
  }
}

TEST_F(Losses, EikonalFollowsTheReference) {
  for (const uint32_t points : {1u, 63u, 65u, 1000u}) {
    std::vector<std::array<double, 3>> gradients(points);
    for (auto& g : gradients) {
      const auto n = uniform(3, -1.2, 1.2);
      g = {n[0], n[1], n[2]};
    }
    if (points > 2) gradients[1] = {0, 0, 0};
    if (points > 2) gradients[2] = {0, 1, 0};
    const auto truth = reference::eikonal_loss(gradients, 40);
    const Outcome actual = eikonal(gradients, 40, 10);
    std::vector<double> expected;
    for (const auto& g : truth.gradient)
      for (double x : g) expected.push_back(10 * x);
    EXPECT_NEAR(actual.value, truth.value, 1e-6 * std::max(1.0, truth.value));
    golden::expect_close("d eikonal of " + std::to_string(points), actual.gradient, expected, 1e-6);
  }
}

TEST_F(Losses, NotANumberReachesTheGradient) {
  const Outcome actual = eikonal({{1, 2, 3}, {NAN, 0, 0}, {INFINITY, 0, 0}}, 1, 1);
  EXPECT_TRUE(std::isfinite(actual.gradient[0]));
  EXPECT_TRUE(std::isnan(actual.gradient[3]));
  EXPECT_FALSE(std::isfinite(actual.gradient[6]));
}

TEST_F(Losses, PenaltiesOfTheSdfFollowTheReference) {
  for (const uint32_t points : {1u, 65u, 1000u}) {
    std::vector<double> sdf;
    for (const float f : uniform(points, -0.02, 0.1)) sdf.push_back(f);
    const auto off = reference::off_surface_loss(sdf, 33);
    Outcome actual = penalty(SdfPenalty::off_surface, sdf, 33, 50);
    EXPECT_NEAR(actual.value, off.value, 3e-6 * std::max(1.0, off.value));
    std::vector<double> expected = off.gradient;
    for (double& x : expected) x *= 50;
    golden::expect_close("d off-surface of " + std::to_string(points), actual.gradient, expected,
                         3e-6 * largest(expected));

    for (double& f : sdf) f = static_cast<float>(f * 0.02);  // sigmoid(5000 f) varies within a millimetre
    if (points > 1) sdf[1] = 1, sdf[2] = -1;
    const auto inside = reference::inside_loss(sdf, 33);
    actual = penalty(SdfPenalty::inside, sdf, 33, 5);
    EXPECT_NEAR(actual.value, inside.value, 3e-6 * std::max(1.0, inside.value));
    expected = inside.gradient;
    for (double& x : expected) x *= 5;
    golden::expect_close("d inside of " + std::to_string(points), actual.gradient, expected, 3e-6 * largest(expected));
  }
}

TEST_F(Losses, OfTheMaskFollowsTheReference) {
  for (const uint32_t rays : {1u, 63u, 65u, 1000u}) {
    for (const bool weighted : {false, true}) {
      std::vector<double> sdf;
      for (const float f : uniform(rays, -0.1, 0.3)) sdf.push_back(f);
      std::vector<float> masks = uniform(rays, 0, 1);
      const std::vector<float> weights = uniform(rays, 0.1, 2);
      std::vector<bool> with_distance(rays, true);
      std::vector<double> in_loss, in_masks, in_weights;
      for (uint32_t i = 0; i < rays; ++i) {
        if (i % 3) masks[i] = i % 3 == 1 ? 1.0F : 0.0F;
        if (i % 17 == 5) sdf[i] = 1e4;
        if (i % 17 == 6) sdf[i] = -1e4;
        if (i % 7 == 4) with_distance[i] = false;
        if (!with_distance[i]) continue;
        in_loss.push_back(sdf[i]);
        in_masks.push_back(masks[i]);
        in_weights.push_back(weights[i]);
      }
      const auto truth = reference::mask_loss(in_loss, in_masks, 40, 77, weighted ? in_weights : std::vector<double>{});
      std::vector<double> expected;
      for (uint32_t i = 0, of_loss = 0; i < rays; ++i) expected.push_back(with_distance[i] ? 3000 * truth.gradient[of_loss++] : 0);
      const Outcome actual = mask(sdf, masks, with_distance, 77, 3000, 40, weighted ? weights : std::vector<float>{});
      EXPECT_NEAR(actual.value, truth.value, 1e-6 * std::max(1.0, truth.value));
      // f s - L is a difference of the loss's own size.
      EXPECT_NEAR(actual.second, truth.d_alpha, 1e-6 * std::max(1.0, truth.value / 40));
      golden::expect_close("d mask of " + std::to_string(rays), actual.gradient, expected, 2e-6 * largest(expected));
    }
  }
  EXPECT_TRUE(std::isnan(mask({NAN}, {1}, {true}, 1, 1, 50, {}).gradient[0])) << "it must reach the optimiser's guard";
}

TEST_F(Losses, TermsOfThePretrainingFollowTheReference) {
  for (const uint32_t points : {1u, 65u, 1000u}) {
    std::vector<double> sdf;
    for (const float f : uniform(points, -0.03, 0.03)) sdf.push_back(f);
    if (points > 2) sdf[1] = 0, sdf[2] = -3;
    for (const SdfPenalty kind : {SdfPenalty::on_surface, SdfPenalty::near_zero}) {
      const auto truth = kind == SdfPenalty::on_surface ? reference::on_surface_loss(sdf, 33) : reference::near_zero_loss(sdf, 33);
      const Outcome actual = penalty(kind, sdf, 33, 50);
      EXPECT_NEAR(actual.value, truth.value, 3e-6 * std::max(1.0, truth.value));
      std::vector<double> expected = truth.gradient;
      for (double& x : expected) x *= 50;
      golden::expect_close("d of points " + std::to_string(points), actual.gradient, expected, 3e-6 * largest(expected));
    }
    std::vector<std::array<double, 3>> gradients(points), normals(points);
    for (uint32_t i = 0; i < points; ++i) {
      const auto g = uniform(3, -1.5, 1.5), n = uniform(3, -1, 1);
      const double length = std::hypot(n[0], n[1], n[2]);
      gradients[i] = {g[0], g[1], g[2]};
      normals[i] = {n[0] / length, n[1] / length, n[2] / length};
    }
    if (points > 2) gradients[1] = {0, 0, 0}, gradients[2] = normals[2];
    const auto truth = reference::normal_loss(gradients, normals, 40);
    const Outcome actual = normal(gradients, normals, 40, 10, 0.25F);
    EXPECT_NEAR(actual.value, truth.value, 2e-6 * std::max(1.0, truth.value));
    std::vector<double> expected;
    for (const auto& g : truth.gradient)
      for (double x : g) expected.push_back(10 * x);
    golden::expect_close("d normals of " + std::to_string(points), actual.gradient, expected, 2e-6 * std::max(1.0, largest(expected)));
  }
  EXPECT_TRUE(std::isnan(penalty(SdfPenalty::on_surface, {NAN}, 1, 1).gradient[0]));
  EXPECT_TRUE(std::isnan(penalty(SdfPenalty::near_zero, {NAN}, 1, 1).gradient[0]));
}

TEST_F(Losses, Golden09) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("09_losses");
  const auto rgb = truth.values("in.rgb"), photograph = truth.values("in.gt"), mask = truth.values("in.net_mask");
  std::vector<float> colors, targets;
  for (size_t i = 0; i < mask.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) {
      colors.push_back(static_cast<float>(rgb[3 * i + c]));
      targets.push_back(static_cast<float>(photograph[3 * i + c]));
    }
    colors.push_back(0.5F);
    targets.push_back(mask[i] != 0 ? 1.0F : -1.0F);
  }
  const float rays = static_cast<float>(mask.size());
  const Outcome color = image(colors, targets, rays, 1, 0);
  EXPECT_NEAR(color.value, truth.scalar("out.colour"), 2e-6 * truth.scalar("out.colour"));
  std::vector<double> d_rgb;
  for (size_t i = 0; i < color.gradient.size(); ++i)
    if (i % 4 != 3) d_rgb.push_back(color.gradient[i]);
  golden::expect_close("grad.rgb", d_rgb, truth.values("grad.rgb"), 1e-8);

  const auto g = truth.values("in.grad");
  std::vector<std::array<double, 3>> gradients(g.size() / 3);
  for (size_t i = 0; i < g.size(); ++i) gradients[i / 3][i % 3] = g[i];
  const Outcome unit = eikonal(gradients, rays, 1);
  EXPECT_NEAR(unit.value, truth.scalar("out.eikonal"), 2e-6 * truth.scalar("out.eikonal"));
  golden::expect_close("grad.grad", unit.gradient, truth.values("grad.grad"), 1.4e-8);

  const Outcome off = penalty(SdfPenalty::off_surface, truth.values("in.off"), rays, 1);
  EXPECT_NEAR(off.value, truth.scalar("out.off"), 2e-6 * truth.scalar("out.off"));
  golden::expect_close("grad.off", off.gradient, truth.values("grad.off"), 2e-6 * largest(truth.values("grad.off")));
  const Outcome inside = penalty(SdfPenalty::inside, truth.values("in.inside"), rays, 1);
  EXPECT_NEAR(inside.value, truth.scalar("out.inside"), 2e-6 * truth.scalar("out.inside"));
  golden::expect_close("grad.inside", inside.gradient, truth.values("grad.inside"),
                       3e-6 * largest(truth.values("grad.inside")));
}

}  // namespace
}  // namespace arah
