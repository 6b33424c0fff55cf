#include "kernels/reference/compositing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "kernels/reference/density.h"
#include "tests/golden.h"
#include "tests/kernels/reference/finite_differences.h"

namespace arah::reference {
namespace {

// One ray's arrays and the loss G·colour + g·weights_sum over them.
struct Ray {
  std::vector<double> sdf, depths, deltas;
  std::vector<std::array<double, 3>> rgb;
  std::vector<std::uint8_t> mask;
  double b = 1e-2;
  DensityKind density = DensityKind::laplace;

  CompositingInput input() const { return {sdf, deltas, depths, rgb, mask, b, density}; }
};

Ray random_ray(int count, double scale, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  Ray ray;
  ray.b = scale;
  for (int i = 0; i < count; ++i) {
    ray.sdf.push_back(scale * 4 * (uniform(generator) - 0.4));
    ray.depths.push_back(i == 0 ? 1 : ray.depths.back() + scale * uniform(generator));
    ray.rgb.push_back({uniform(generator), uniform(generator), uniform(generator)});
    ray.mask.push_back(uniform(generator) < 0.8);
  }
  ray.deltas = depth_differences(ray.depths, ray.mask);
  return ray;
}

void expect_all_finite(const Ray& ray, const Composite& result, const CompositingGradient& gradient) {
  for (std::size_t i = 0; i < ray.sdf.size(); ++i) {
    EXPECT_TRUE(std::isfinite(result.density[i]) && std::isfinite(result.alpha[i]) && std::isfinite(result.weights[i]));
    EXPECT_GE(result.alpha[i], 0);
    EXPECT_LE(result.alpha[i], 1);
    EXPECT_GE(result.weights[i], 0);
    EXPECT_TRUE(std::isfinite(gradient.sdf[i]));
    for (double value : gradient.rgb[i]) EXPECT_TRUE(std::isfinite(value));
  }
  EXPECT_TRUE(std::isfinite(gradient.b) && std::isfinite(result.depth) && std::isfinite(result.colour[0]));
  EXPECT_GE(result.weights_sum, 0);
  EXPECT_LE(result.weights_sum, 1);
}

TEST(LaplaceDensity, ScaleIsClippedAndItsGradientPassesAtTheBounds) {
  EXPECT_EQ(laplace_scale(-0.005), 0.005);
  EXPECT_EQ(laplace_scale(0), 1e-6);
  EXPECT_EQ(laplace_scale(-1e9), 1e6);
  EXPECT_EQ(laplace_scale_derivative(-0.005), -1);
  EXPECT_EQ(laplace_scale_derivative(1e-6), 1);
  EXPECT_EQ(laplace_scale_derivative(1e6), 1);
  EXPECT_EQ(laplace_scale_derivative(1e-7), 0);
  EXPECT_EQ(laplace_scale_derivative(0), 0);
}

TEST(LaplaceDensity, StableFarFromTheSurfaceAtEveryScale) {
  for (double b : {1e-6, 1e-3, 1.0, 1e3, 1e6}) {
    for (double u : {0.0, 1e-9, 0.5, 1.0, 16.0, 36.0, 700.0, 1e4, 1e9}) {
      for (double side : {-1.0, 1.0}) {
        const Density density = laplace_density(side * u * b, b);
        ASSERT_TRUE(std::isfinite(density.value) && std::isfinite(density.d_sdf) && std::isfinite(density.d_b));
        const double tail = 0.5 * std::exp(-u) / b;
        EXPECT_NEAR(density.value, side > 0 ? tail : 1 / b - tail, 1e-15 / b) << b << " " << u;
        // Outside, the relative accuracy must hold too: no cancellation where the density is small.
        if (side > 0 && tail > 0) {
          EXPECT_NEAR(density.value / tail, 1, 1e-12);
        }
        EXPECT_LE(density.d_sdf, 0);
      }
    }
  }
}

TEST(LaplaceDensity, DerivativesAgreeWithDifferences) {
  for (double b : {1e-4, 3e-3, 0.7, 1e3}) {
    for (double u : {-7.0, -1.3, -0.2, 0.2, 0.999, 1.3, 7.0}) {
      double s = u * b, scale = b;
      const Density density = laplace_density(s, b);
      const auto value = [&] { return laplace_density(s, scale).value; };
      expect_gradient("density by sdf", value, {&s, 1}, {&density.d_sdf, 1}, 1e-3 * b);
      expect_gradient("density by b", value, {&scale, 1}, {&density.d_b, 1}, 1e-3 * b);
    }
  }
}

TEST(SoftplusDensity, StableAtEveryScale) {
  for (double b : {1e-6, 1e-3, 1.0, 1e3, 1e6}) {
    for (double u : {0.0, 1e-9, 0.5, 1.0, 16.0, 36.0, 700.0, 1e4, 1e9}) {
      const Density outside = softplus_density(u * b, b), inside = softplus_density(-u * b, b);
      for (const Density& density : {outside, inside}) {
        ASSERT_TRUE(std::isfinite(density.value) && std::isfinite(density.d_sdf) && std::isfinite(density.d_b));
        EXPECT_LE(density.d_sdf, 0);
      }
      EXPECT_NEAR((inside.value - outside.value) * b, u, 1e-12 * (1 + u)) << "softplus(u) − softplus(−u) = u";
      if (u > 36 && u < 700) {
        EXPECT_NEAR(outside.value * b / std::exp(-u), 1, 1e-12) << "the exponential's tail keeps its digits";
      }
    }
    EXPECT_NEAR(softplus_density(0, b).value * b, std::log(2.0), 1e-15);
  }
}

TEST(SoftplusDensity, DerivativesAgreeWithDifferences) {
  for (double b : {1e-4, 3e-3, 0.7, 1e3}) {
    for (double u : {-7.0, -1.3, -0.2, 0.0, 0.2, 0.999, 1.3, 7.0}) {
      double s = u * b, scale = b;
      const Density density = softplus_density(s, b);
      const auto value = [&] { return softplus_density(s, scale).value; };
      expect_gradient("density by s", value, {&s, 1}, {&density.d_sdf, 1}, 1e-3 * b);
      expect_gradient("density by b", value, {&scale, 1}, {&density.d_b, 1}, 1e-3 * b);
    }
  }
}

TEST(DepthDifferences, SkipMaskedSamples) {
  const std::vector<double> z{1, 2, 4, 8, 16};
  const std::vector<std::uint8_t> some{0, 1, 0, 1, 0}, none{0, 0, 0, 0, 0};
  EXPECT_EQ(depth_differences(z, some), (std::vector<double>{0, 6, 0, 1.0 / 64, 0}));
  EXPECT_EQ(depth_differences(z, none), std::vector<double>(5, 0.0));
  EXPECT_TRUE(depth_differences({}, {}).empty());
}

TEST(Compositing, Golden08) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("08_composite");
  const std::size_t rays = truth.extent("in.sdf", 0), samples = truth.extent("in.sdf", 1);
  const auto sdf = truth.values("in.sdf"), z = truth.values("in.z"), rgb = truth.values("in.rgb"),
             weights = truth.values("in.G"), parameters = truth.values("in.b");
  const auto mask = truth.tensor("in.mask").as<std::uint8_t>();
  for (std::size_t index = 0; index < parameters.size(); ++index) {
    const double parameter = index == 0 ? 1e-6 : parameters[index];
    const std::size_t all = rays * samples;
    std::vector<double> density(all), alpha(all), w(all), colour, sums, grad_sdf, grad_rgb;
    double loss = 0, grad_b = 0;
    for (std::size_t r = 0; r < rays; ++r) {
      Ray ray;
      ray.b = laplace_scale(parameter);
      for (std::size_t i = r * samples; i < (r + 1) * samples; ++i) {
        ray.sdf.push_back(sdf[i]);
        ray.depths.push_back(z[i]);
        ray.rgb.push_back({rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]});
        ray.mask.push_back(mask[i]);
      }
      ray.deltas = depth_differences(ray.depths, ray.mask);
      const Composite result = composite(ray.input());
      const std::array<double, 3> upstream{weights[3 * r], weights[3 * r + 1], weights[3 * r + 2]};
      const CompositingGradient gradient = composite_backward(ray.input(), result, upstream, 0);
      std::size_t compacted = r * samples;
      for (std::size_t i = 0; i < samples; ++i) {
        grad_sdf.push_back(gradient.sdf[i]);
        grad_rgb.insert(grad_rgb.end(), gradient.rgb[i].begin(), gradient.rgb[i].end());
        if (!ray.mask[i]) continue;
        density[compacted] = result.density[i];
        alpha[compacted] = result.alpha[i];
        w[compacted++] = result.weights[i];
      }
      for (int c = 0; c < 3; ++c) loss += upstream[c] * result.colour[c];
      colour.insert(colour.end(), result.colour.begin(), result.colour.end());
      sums.push_back(result.weights_sum);
      grad_b += gradient.b * laplace_scale_derivative(parameter);
    }
    const std::string out = "out." + std::to_string(index) + ".", grad = "grad." + std::to_string(index) + ".";
    golden::expect_golden(truth, out + "density", density);
    golden::expect_golden(truth, out + "alpha", alpha);
    golden::expect_golden(truth, out + "w", w);
    golden::expect_golden(truth, out + "colour", colour);
    golden::expect_golden(truth, out + "weights_sum", sums);
    golden::expect_golden(truth, out + "L", loss);
    golden::expect_golden(truth, grad + "rgb", grad_rgb);
    if (index > 0) {
      golden::expect_golden(truth, grad + "sdf", grad_sdf);
      golden::expect_golden(truth, grad + "b", grad_b);
    } else {
      // At b = 1e-6 the truth's own form, ½ − ½(1 − exp(−s/b)), cancels to 0; ours keeps exp(−7e2) and the like.
      golden::expect_close(grad + "sdf", grad_sdf, truth.values(grad + "sdf"), 1e-290);
      golden::expect_close(grad + "b", {&grad_b, 1}, truth.values(grad + "b"), 1e-290);
    }
  }
}

TEST(Compositing, GradientsAgreeWithDifferences) {
  for (int count : {1, 2, 7, 33}) {
    for (const auto& [scale, density] : {std::pair{1e-3, DensityKind::laplace}, {0.05, DensityKind::laplace}, {2.0, DensityKind::laplace}, {1e-3, DensityKind::softplus}, {2.0, DensityKind::softplus}}) {
      Ray ray = random_ray(count, scale, static_cast<unsigned>(count));
      ray.density = density;
      ray.mask[0] = 1;
      // With a last δ of 1/64 m a ray of b = 1e-3 m would saturate, and differences of its colour be rounding.
      ray.deltas = depth_differences(ray.depths, ray.mask, 0.5 * scale);
      if (count == 7) std::fill(ray.deltas.begin(), ray.deltas.end(), 0.3 * scale);  // a stratum's share instead
      const std::array<double, 3> upstream{0.7, -1.1, 0.4};
      const auto loss = [&](double of_sum) {
        const Composite result = composite(ray.input());
        return upstream[0] * result.colour[0] + upstream[1] * result.colour[1] + upstream[2] * result.colour[2] +
               of_sum * result.weights_sum;
      };
      const Composite forward = composite(ray.input());
      // Away from the clip only: at an opaque ray's Σw near 1 a difference may straddle it.
      const double of_sum = forward.weights_sum < 1 - 1e-4 ? 1.7 : 0;
      const CompositingGradient gradient = composite_backward(ray.input(), forward, upstream, of_sum);
      const auto value = [&] { return loss(of_sum); };
      const std::size_t channels = 3 * ray.rgb.size();
      expect_gradient("dL/dsdf", value, ray.sdf, gradient.sdf, 1e-4 * scale);
      expect_gradient("dL/db", value, {&ray.b, 1}, {&gradient.b, 1}, 1e-4 * scale);
      expect_gradient("dL/drgb", value, {ray.rgb.front().data(), channels}, {gradient.rgb.front().data(), channels});
    }
  }
}

TEST(Compositing, ClippedSumPassesNoGradient) {
  // Three samples of optical depth near 20: Σw = 1 + 1e-7 or so is clipped, while every dσ is still alive.
  Ray ray{{-1e-3, -1e-3, -1e-3}, {1, 2, 3}, {0.025, 0.025, 0.025}, {{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}, {1, 1, 1}, 1e-3, DensityKind::laplace};
  const Composite result = composite(ray.input());
  EXPECT_EQ(result.weights_sum, 1);
  const CompositingGradient gradient = composite_backward(ray.input(), result, {0, 0, 0}, 1);
  EXPECT_EQ(gradient.sdf, std::vector<double>(3, 0.0));
  EXPECT_EQ(gradient.b, 0);
  EXPECT_NE(composite_backward(ray.input(), result, {1, 0, 0}, 0).sdf[0], 0);
}

TEST(Compositing, MaskedSamplesChangeNothing) {
  Ray ray = random_ray(19, 0.02, 3);
  Ray kept;
  kept.b = ray.b;
  for (int i = 0; i < 19; ++i) {
    if (!ray.mask[i]) continue;
    kept.sdf.push_back(ray.sdf[i]);
    kept.depths.push_back(ray.depths[i]);
    kept.deltas.push_back(ray.deltas[i]);
    kept.rgb.push_back(ray.rgb[i]);
    kept.mask.push_back(1);
  }
  ASSERT_LT(kept.sdf.size(), ray.sdf.size());
  const Composite with = composite(ray.input()), without = composite(kept.input());
  EXPECT_EQ(with.colour, without.colour);
  EXPECT_EQ(with.weights_sum, without.weights_sum);
  EXPECT_EQ(with.depth, without.depth);
}

TEST(Compositing, NoSampleAndAllMaskedAreBlack) {
  const Ray none;
  EXPECT_EQ(composite(none.input()).colour, (std::array<double, 3>{0, 0, 0}));
  Ray masked = random_ray(9, 0.01, 4);
  std::fill(masked.mask.begin(), masked.mask.end(), 0);
  masked.sdf[3] = std::nan("");  // what a failed search may leave behind
  masked.rgb[3][0] = std::nan("");
  const Composite result = composite(masked.input());
  const CompositingGradient gradient = composite_backward(masked.input(), result, {1, 1, 1}, 1);
  expect_all_finite(masked, result, gradient);
  EXPECT_EQ(result.colour, (std::array<double, 3>{0, 0, 0}));
  EXPECT_EQ(result.weights_sum, 0);
  EXPECT_EQ(gradient.sdf, std::vector<double>(9, 0.0));
}

TEST(Compositing, FiniteFromTheThinnestToTheDensest) {
  // Density times delta from 0 to 1e12: b down to 1e-6 (σ up to 1e6) and δ up to 1e6 m.
  for (double b : {1e-6, 1e-3, 1.0, 1e6}) {
    for (double delta : {0.0, 1e-300, 1e-9, 1.0, 1e6}) {
      Ray ray = random_ray(11, b, 5);
      for (int i = 0; i < 11; ++i)
        ray.sdf[i] = (i % 2 ? 1 : -1) * b * std::pow(10.0, i - 1);  // |sdf|/b from 0.1 to 1e9
      std::fill(ray.deltas.begin(), ray.deltas.end(), delta);
      const Composite result = composite(ray.input());
      expect_all_finite(ray, result, composite_backward(ray.input(), result, {1, -1, 2}, 1));
      if (delta == 0) {
        EXPECT_EQ(result.weights_sum, 0);
      }
    }
  }
}

TEST(Compositing, TinyOpticalDepthKeepsItsDigits) {
  // 1 − exp(−τ) would lose all of τ = 1e-20.
  Ray ray{{1.0}, {1.0}, {2e-20}, {{1, 1, 1}}, {1}, 1.0, DensityKind::laplace};
  EXPECT_NEAR(composite(ray.input()).colour[0] / (0.5 * std::exp(-1.0) * 2e-20), 1, 1e-14);
}

TEST(Compositing, ThousandOpaqueSamples) {
  Ray ray = random_ray(1000, 1e-3, 6);
  std::fill(ray.mask.begin(), ray.mask.end(), 1);
  std::fill(ray.sdf.begin(), ray.sdf.end(), -1.0);
  std::fill(ray.deltas.begin(), ray.deltas.end(), 1.0);
  const Composite result = composite(ray.input());
  const CompositingGradient gradient = composite_backward(ray.input(), result, {1, 1, 1}, 1);
  expect_all_finite(ray, result, gradient);
  EXPECT_EQ(result.transmittance.back(), 0);  // 1e-7^999 underflows
  EXPECT_EQ(result.weights_sum, 1);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(result.colour[c], ray.rgb[0][c], 1e-6);
}

}  // namespace
}  // namespace arah::reference
