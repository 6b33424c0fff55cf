// Densities and compositing at the ends of their ranges. The truth is in long double where relative errors are asked for.
#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "tests/extremes/extremes.h"
#include "tests/kernels/composited.h"

namespace arah {
namespace {

using namespace extremes;

constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();

// Rays of one white sample each, of which the loss is the sum of the red channels: dL/dw = 1.
SampleBatch single_samples(const std::vector<float>& sdf, const std::vector<float>& deltas, float b, DensityKind density) {
  SampleBatch batch;
  batch.rays = static_cast<uint32_t>(sdf.size());
  batch.samples = 1;
  batch.sdf = sdf;
  batch.deltas = deltas;
  batch.rgb.assign(3 * sdf.size(), 1);
  batch.depths.assign(sdf.size(), 1);
  batch.mask.assign(sdf.size(), 1);
  batch.parameter = b;
  batch.density = density;
  for (size_t i = 0; i < sdf.size(); ++i) batch.d_colors.insert(batch.d_colors.end(), {1, 0, 0, 0});
  return batch;
}

// σ, its slopes, and by what a float32 error of each is measured: relative where the exponential's argument u is small, growing
// with it (the error of e^−u is that of u), and what is added up counted in full.
struct Truth {
  long double value, d_sdf, d_b, u, size_of_d_b;
};
Truth density_truth(DensityKind kind, float s_float, float b_float) {
  const long double s = s_float, b = b_float, u = std::abs(s) / b, tail = std::exp(-u) / (2 * b);
  if (kind == DensityKind::laplace) {
    const long double d_tail = tail * (u - 1) / b, size = tail * (u + 1) / b;
    if (s > 0) return {tail, -tail / b, d_tail, u, size};
    return {1 / b - tail, s == 0 ? 0 : -tail / b, -1 / (b * b) - d_tail, u, 1 / (b * b) + size};
  }
  const long double raw = -s / b, softplus = std::max(raw, 0.0L) + std::log1p(std::exp(-u)), sigmoid = raw >= 0 ? 1 / (1 + std::exp(-u)) : std::exp(-u) / (1 + std::exp(-u));
  return {softplus / b, -sigmoid / (b * b), -(softplus + raw * sigmoid) / (b * b), u, (softplus + u * sigmoid) / (b * b)};
}

class CompositingExtremes : public CompositingTest {
 protected:
  // Of w, dL/dsdf and dL/db; each over (1 + u) times its size.
  struct Errors {
    double weight = 0, d_sdf = 0, d_b = 0;
  };
  Errors errors_at(DensityKind kind, float b, const std::vector<float>& sdf, const std::vector<float>& deltas) {
    const CompositedBatch found = run(single_samples(sdf, deltas, b, kind), false);
    Errors errors;
    const auto note = [](double& largest, double value, long double truth, long double unit) {
      const double error = value == truth ? 0 : static_cast<double>(std::abs(value - truth) / unit);
      if (!(error <= largest)) largest = error;
    };
    for (size_t i = 0; i < sdf.size(); ++i) {
      const Truth at = density_truth(kind, sdf[i], b);
      const long double delta = deltas[i], depth = at.value * delta, passed = delta * std::exp(-depth), inside = 1 + at.u + depth;
      const long double w = -std::expm1(-depth), tiny = 1e-30L;  // of what is largest at this b: float32 underflows below
      note(errors.weight, found.weights[i], w, inside * w + tiny);
      note(errors.d_sdf, found.d_sdf[i], passed * at.d_sdf, inside * passed * std::abs(at.d_sdf) + tiny * delta / (b * b));
      // The sum over rays is no place to look at one.
      const double d_b = run(single_samples({sdf[i]}, {deltas[i]}, b, kind), false, 0).d_parameter;
      note(errors.d_b, d_b, passed * at.d_b, inside * passed * at.size_of_d_b + tiny * delta / (b * b));
    }
    return errors;
  }
};

TEST_F(CompositingExtremes, LaplaceScaleFromAMicrometreToAThousandKilometres) {
  for (const DensityKind kind : {DensityKind::laplace, DensityKind::softplus})
    for (const float b : {1e-6F, 1e-3F, 1.0F, 1e3F, 1e6F}) {
      std::vector<float> sdf, deltas;
      for (const double u : {0.0, 1e-9, 1e-3, 0.3, 0.999, 1.3, 7.0, 20.0, 60.0, 88.0, 105.0, 1e4, 1e9})
        for (const double side : {-1.0, 1.0}) {
          sdf.push_back(static_cast<float>(side * u * b));
          const bool unbounded = kind == DensityKind::softplus && side < 0;
          deltas.push_back(static_cast<float>(1e-3 * b / (unbounded ? 1 + u : 1)));  // thin, so that w tells of σ
        }
      const Errors errors = errors_at(kind, b, sdf, deltas);
      const std::string name = fmt::format("{} density, b = {:g} m, |sdf|/b = u from 0 to 1e9 on both sides", kind == DensityKind::laplace ? "Laplace" : "softplus", b);
      expect_within(Row::laplace_scale, Way::forward, name, "relative error of the weight / (1 + u)", errors.weight, float32_bound);
      expect_within(Row::laplace_scale, Way::backward, name + ": dL/dsdf", "relative error / (1 + u)", errors.d_sdf, float32_bound);
      expect_within(Row::laplace_scale, Way::backward, name + ": dL/db", "error of its two terms' sizes / (1 + u)", errors.d_b, float32_bound);
    }
}

TEST_F(CompositingExtremes, ScalesBeyondTheirBoundsAreTheBoundsAndHaveNoSlope) {
  for (const auto& [parameter, b] : {std::pair{0.0F, 1e-6F}, {1e-9F, 1e-6F}, {-1e-9F, 1e-6F}, {1e9F, 1e6F}, {-1e9F, 1e6F}}) {
    const CompositedBatch found = run(single_samples({-0.5F * b}, {b}, parameter, DensityKind::laplace), false, 0);
    const Truth at = density_truth(DensityKind::laplace, -0.5F * b, b);
    const std::vector<double> truth = {static_cast<double>(-std::expm1(-at.value * b))};
    const std::string name = fmt::format("the parameter {:g} stands for b = {:g} m", parameter, b);
    expect_within(Row::laplace_scale, Way::forward, name, "relative error of the weight", largest_error(found.weights, truth, 0), float32_bound);
    expect_that(Row::laplace_scale, Way::backward, name, "dL/dparameter = 0", found.d_parameter == 0);
  }
}

TEST_F(CompositingExtremes, OpticalDepthsFromNothingToATrillion) {
  const float b = 1e-6F;
  const std::vector<double> depths = {0, 1e-30, 1e-12, 1e-7, 1e-3, 0.4, 0.6, 1, 10, 50, 87, 1e3, 1e6, 1e12};
  const long double density = density_truth(DensityKind::laplace, -0.5F * b, b).value;
  std::vector<float> sdf(depths.size(), -0.5F * b), deltas;
  for (const double depth : depths) deltas.push_back(static_cast<float>(depth / static_cast<double>(density)));
  const Errors errors = errors_at(DensityKind::laplace, b, sdf, deltas);
  const CompositedBatch found = run(single_samples(sdf, deltas, b, DensityKind::laplace), false);
  const size_t last = depths.size() - 1;
  std::vector<double> truth;
  for (size_t i = 0; i < depths.size(); ++i) truth.push_back(static_cast<double>(-std::expm1(-density * deltas[i])));
  const char* const name = "density·δ from 1e-30 to 1e12";
  expect_within(Row::optical_depth, Way::forward, name, "relative error of α = 1 − exp(−density·δ)", largest_error(found.weights, truth, 1e-38), float32_bound);
  expect_within(Row::optical_depth, Way::backward, std::string(name) + ": dL/dsdf", "relative error / (1.5 + density·δ)", errors.d_sdf, float32_bound);
  expect_within(Row::optical_depth, Way::backward, std::string(name) + ": dL/db", "relative error / (1.5 + density·δ)", errors.d_b, float32_bound);
  expect_that(Row::optical_depth, Way::forward, "δ = 0, density 7e5/m", "weight 0", found.weights[0] == 0);
  expect_that(Row::optical_depth, Way::backward, "δ = 0, density 7e5/m", "dL/dsdf = 0", found.d_sdf[0] == 0);
  expect_that(Row::optical_depth, Way::forward, "density·δ = 1e12", "weight 1", found.weights[last] == 1);
  expect_that(Row::optical_depth, Way::backward, "density·δ = 1e12", "dL/dsdf = 0", found.d_sdf[last] == 0);
}

// A thousand samples on each of two rays.
TEST_F(CompositingExtremes, AThousandSamples) {
  for (const float depth : {1e-4F, 10.0F, 1e12F}) {
    SampleBatch batch = random_batch(2, 1000, 1e-6F);
    batch.metres_per_unit = 1;
    std::fill(batch.mask.begin(), batch.mask.end(), uint8_t(1));
    std::fill(batch.sdf.begin(), batch.sdf.end(), -30e-6F);  // σ = 1e6
    std::fill(batch.deltas.begin(), batch.deltas.end(), depth * 1e-6F);
    const CompositedBatch found = run(batch, false, 0), truth = composited_truth(batch, false);
    const std::string name = fmt::format("1,000 samples of density·δ = {:g}", depth);
    expect_within(Row::opaque_samples, Way::forward, name + ": transmittance before each", "relative error / 1,000", largest_error(found.transmittances, truth.transmittances, 1e-35) / 1000, 5e-7);
    expect_within(Row::opaque_samples, Way::forward, name + ": colour", "error", largest_error(found.color, truth.color, 1), 1e-5);
    expect_within(Row::opaque_samples, Way::forward, name + ": Σ weights", "error", largest_error(found.sums, truth.sums, 1), 1e-5);
    if (depth > 1e3F) {
      expect_that(Row::opaque_samples, Way::backward, name + ": dL/dsdf", "0: nothing passes, so that nothing can be learned", all_zero(found.d_sdf));
    } else {
      expect_within(Row::opaque_samples, Way::backward, name + ": dL/dsdf", "error, of the largest", error_of_largest(found.d_sdf, truth.d_sdf), 2e-4);
    }
    expect_within(Row::opaque_samples, Way::backward, name + ": dL/drgb", "error, of the largest", error_of_largest(found.d_rgb, truth.d_rgb), 1e-4);
    expect_that(Row::opaque_samples, Way::backward, name + ": dL/db", "finite", std::isfinite(found.d_parameter));
    if (depth > 1) expect_that(Row::opaque_samples, Way::forward, name + ": the transmittance of the last", "0, by underflow", found.transmittances.back() == 0);
  }
}

TEST_F(CompositingExtremes, FewSamplesOrNone) {
  SampleBatch one = random_batch(65, 1, 0.01F);
  std::fill(one.mask.begin(), one.mask.end(), uint8_t(1));
  for (const bool differences : {false, true}) {
    const CompositedBatch found = run(one, differences), truth = composited_truth(one, differences);
    const std::string name = differences ? "one sample, δ of 1/64 m for the last" : "one sample, δ given";
    expect_within(Row::few_samples, Way::forward, name, "relative error of the weight", largest_error(found.weights, truth.weights, 1e-6), 4e-6);
    expect_within(Row::few_samples, Way::backward, name + ": dL/dsdf", "error, of the largest", error_of_largest(found.d_sdf, truth.d_sdf), 4e-6);
  }
  SampleBatch masked = random_batch(65, 9, 0.01F);  // what is masked holds NaN
  std::fill(masked.mask.begin(), masked.mask.end(), uint8_t(0));
  for (const bool differences : {false, true}) {
    masked.deltas.assign(masked.rows(), not_a_number);
    const CompositedBatch found = run(masked, differences, 0);
    const std::string name = differences ? "all samples masked, δ from depths" : "all samples masked, δ given";
    expect_that(Row::few_samples, Way::forward, name, "black, Σ weights 0, depth 0", all_zero(found.color) && all_zero(found.sums) && all_zero(found.depths) && all_zero(found.weights));
    expect_that(Row::few_samples, Way::backward, name, "every gradient 0", all_zero(found.d_sdf) && all_zero(found.d_rgb) && found.d_parameter == 0);
  }
  CompositeForwardArgs forward;
  forward.samples.rays = 1;
  CompositeBackwardArgs backward;
  backward.samples.rays = 1;
  expect_error<std::invalid_argument>(Row::few_samples, Way::forward, "no sample", {"1 rays of 0 samples", "at least 1"}, [&] { record_composite_forward(commands, forward); });
  expect_error<std::invalid_argument>(Row::few_samples, Way::backward, "no sample", {"1 rays of 0 samples", "at least 1"}, [&] { record_composite_backward(commands, backward); });
}

TEST_F(CompositingExtremes, DenormalNumbers) {
  const float tiny = 1e-40F;
  for (const DensityKind kind : {DensityKind::laplace, DensityKind::softplus}) {
    const std::string name = kind == DensityKind::laplace ? "Laplace density" : "softplus density";
    const std::vector<float> sdf = {tiny, -tiny, 0, 1e-6F};
    const CompositedBatch found = run(single_samples(sdf, {1e-6F, 1e-6F, 1e-6F, tiny}, 1e-6F, kind), false);
    const double half = kind == DensityKind::laplace ? 0.5 : std::log(2.0), at_surface = -std::expm1(-half);
    const std::vector<double> truth = {at_surface, at_surface, at_surface};
    expect_within(Row::denormals, Way::forward, name + " at sdf ±1e-40 m: weight", "relative error", largest_error(std::span(found.weights).first(3), truth, 0), float32_bound);
    expect_that(Row::denormals, Way::forward, name + ", δ = 1e-40 m: weight", "below 1e-33, not negative", found.weights[3] >= 0 && found.weights[3] < 1e-33);
    // Laplace's slope is flat at 0 itself: a device that takes denormals for 0 gives that.
    const double slope = kind == DensityKind::laplace ? -0.5e12 : -0.5e12, expected = slope * 1e-6 * std::exp(-half);
    const auto either = [&](double d) { return std::abs(d / expected - 1) < 1e-5 || (kind == DensityKind::laplace && d == 0); };
    expect_that(Row::denormals, Way::backward, name + " at sdf ±1e-40 m: dL/dsdf", kind == DensityKind::laplace ? "that of the limit at 0, or that at 0, which is 0" : "that at 0", either(found.d_sdf[0]) && either(found.d_sdf[1]));
    expect_that(Row::denormals, Way::backward, name + ", δ = 1e-40 m: dL/dsdf", "below 1e-27, finite", std::abs(found.d_sdf[3]) < 1e-27);
  }
}

TEST_F(CompositingExtremes, NotANumberIsSeen) {
  for (const DensityKind kind : {DensityKind::laplace, DensityKind::softplus}) {
    const std::string name = kind == DensityKind::laplace ? "Laplace density" : "softplus density";
    const CompositedBatch of_sdf = run(single_samples({not_a_number, -0.01F}, {0.01F, 0.01F}, 0.01F, kind), false, 0);
    expect_that(Row::not_a_number, Way::forward, name + " of an sdf that is NaN", "NaN in colour and Σ weights, of its ray alone", std::isnan(of_sdf.color[0]) && std::isnan(of_sdf.sums[0]) && std::isfinite(of_sdf.color[3]) && std::isfinite(of_sdf.sums[1]));
    expect_that(Row::not_a_number, Way::backward, name + " of an sdf that is NaN", "NaN in dL/dsdf and dL/db", std::isnan(of_sdf.d_sdf[0]) && std::isfinite(of_sdf.d_sdf[1]) && std::isnan(of_sdf.d_parameter));
    const CompositedBatch of_b = run(single_samples({-0.01F}, {0.01F}, not_a_number, kind), false, 0);
    expect_that(Row::not_a_number, Way::forward, name + " of a b that is NaN", "NaN in colour and Σ weights", std::isnan(of_b.color[0]) && std::isnan(of_b.sums[0]));
    expect_that(Row::not_a_number, Way::backward, name + " of a b that is NaN", "NaN in dL/dsdf", std::isnan(of_b.d_sdf[0]));
  }
}

}  // namespace
}  // namespace arah
