// The errors of single formulas over their whole ranges, against long double, as the device finds them; beside them what the
// plain form of the formula would give in the same precision. Drawn into docs/pictures.
#include <array>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>

#include "host/body/kinematics_gradient.h"
#include "host/body/pose.h"
#include "host/evaluation/plot.h"
#include "kernels/color/posed_normals.h"
#include "tests/extremes/activations_on_device.h"
#include "tests/extremes/extremes.h"
#include "tests/extremes/rotations_in_long_double.h"
#include "tests/kernels/composited.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

using namespace extremes;

// Exponents of ten from `first` to `last`.
std::vector<double> exponents(double first, double last, double step) {
  std::vector<double> values;
  for (double value = first; value <= last + 1e-9; value += step) values.push_back(value);
  return values;
}

// A curve of log10 of errors; what is below `floor` lies on it, what is no number, or wrong altogether, on 0.
PlotSeries curve(const std::string& label, const std::vector<double>& at, const std::vector<double>& errors, double floor) {
  PlotSeries series{label, {}};
  for (size_t i = 0; i < at.size(); ++i) series.points.push_back({at[i], std::isfinite(errors[i]) ? std::log10(std::min(std::max(errors[i], floor), 1.0)) : 0, {}});
  return series;
}
double largest(const std::vector<double>& errors) {
  double result = 0;
  for (const double error : errors)
    if (!(error <= result)) result = error;
  return result;
}

class Curves : public CompositingTest {
 protected:
  // Weights of single samples, [sdf]; deltas in metres.
  std::vector<double> weights(DensityKind kind, const std::vector<float>& sdf, const std::vector<float>& deltas) {
    SampleBatch batch;
    batch.rays = static_cast<uint32_t>(sdf.size()), batch.samples = 1;
    batch.sdf = sdf, batch.deltas = deltas;
    batch.rgb.assign(3 * sdf.size(), 1), batch.depths.assign(sdf.size(), 1), batch.mask.assign(sdf.size(), 1), batch.d_colors.assign(4 * sdf.size(), 1);
    batch.parameter = 1, batch.density = kind;
    return run(batch, false).weights;
  }
  static double relative(double found, long double truth) { return static_cast<double>(std::abs((found - truth) / truth)); }
};

constexpr double floor_of_float32 = 1e-9;

TEST_F(Curves, RelativeErrorsOfFormulas) {
  Plot plot{"Relative errors in float32: what the device finds, and plain forms", "log10 x", "log10 of the relative error", {}, true};
  constexpr double floor = floor_of_float32;
  {
    const std::vector<double> at = exponents(-30, 2, 0.5);
    std::vector<float> sdf, deltas;
    const long double density = 1 - std::exp(-0.5L) / 2;  // at −b/2 with b = 1 m
    for (const double exponent : at) sdf.push_back(-0.5F), deltas.push_back(static_cast<float>(std::pow(10, exponent) / static_cast<double>(density)));
    const std::vector<double> found = weights(DensityKind::laplace, sdf, deltas);
    std::vector<double> errors, plain;
    for (size_t i = 0; i < at.size(); ++i) {
      const long double x = density * deltas[i], truth = -std::expm1(-x);
      errors.push_back(relative(found[i], truth)), plain.push_back(relative(1.0F - std::exp(-static_cast<float>(x)), truth));
    }
    expect_within(Row::optical_depth, Way::forward, "1 − exp(−x), x from 1e-30 to 100", "relative error", largest(errors), float32_bound);
    plot.series.push_back(curve("1 − exp(−x)", at, errors, floor));
    plot.series.push_back(curve("1 − exp(−x), plain", at, plain, floor));
  }
  {
    const std::vector<double> at = exponents(-34, 0, 0.5);
    std::vector<float> sdf, deltas;
    for (const double exponent : at) sdf.push_back(static_cast<float>(-exponent * std::log(10.0))), deltas.push_back(1e-3F);
    const std::vector<double> found = weights(DensityKind::softplus, sdf, deltas);
    std::vector<double> errors, plain, scaled;
    for (size_t i = 0; i < at.size(); ++i) {
      const long double u = sdf[i], soft = std::log1p(std::exp(-u)), truth = -std::expm1(-soft * deltas[i]);
      errors.push_back(relative(found[i], truth)), plain.push_back(relative(std::log(1.0F + std::exp(-sdf[i])), soft));
      scaled.push_back(errors.back() / (1 + double{sdf[i]}));
    }
    expect_within(Row::laplace_scale, Way::forward, "log(1 + x), x from 1e-34 to 1, by the softplus density at −log x", "relative error / (1 − log x)", largest(scaled), float32_bound);
    plot.series.push_back(curve("log(1 + x)", at, errors, floor));
    plot.series.push_back(curve("log(1 + x), plain", at, plain, floor));
  }
  {
    const std::vector<double> at = exponents(-37, 38, 1);
    std::vector<float> rows(8 * 128, 0.0F);
    std::vector<double> truth;
    for (size_t i = 0; i < at.size(); ++i) {
      const std::array<double, 3> v{0.48 * std::pow(10, at[i]), -0.6 * std::pow(10, at[i]), 0.64 * std::pow(10, at[i])};
      double size = 0;
      for (size_t c = 0; c < 3; ++c) rows[8 * i + c] = static_cast<float>(v[c]), size = std::hypot(size, double{rows[8 * i + c]});
      for (size_t c = 0; c < 3; ++c) truth.push_back(double{rows[8 * i + c]} / size);
    }
    Buffer gradients = filled("gradients", rows), normals = empty("normals", 128 * 16);
    record_posed_normals(commands, {static_cast<uint32_t>(at.size()), {gradients.slice(), 8, 0}, {}, normals.slice(), true});
    commands.submit_and_wait();
    const std::vector<double> found = rows_of(device.download<float>(normals.slice()), at.size(), 3, 4);
    std::vector<double> errors, plain;
    for (size_t i = 0; i < at.size(); ++i) {
      const float x = rows[8 * i], y = rows[8 * i + 1], z = rows[8 * i + 2], size = std::sqrt(x * x + y * y + z * z);
      const auto distance = [&](double a, double b, double c) { return std::hypot(a - truth[3 * i], b - truth[3 * i + 1], c - truth[3 * i + 2]); };
      errors.push_back(distance(found[3 * i], found[3 * i + 1], found[3 * i + 2]));
      plain.push_back(size > 0 ? distance(double{x / size}, double{y / size}, double{z / size}) : 1);
    }
    expect_within(Row::denormals, Way::forward, "v / |v|, |v| from 1e-37 to 1e38", "error", largest(errors), 1e-6);
    plot.series.push_back(curve("v / |v|, |v| = x", at, errors, floor));
    plot.series.push_back(curve("v / |v|, plain", at, plain, floor));
  }
  keep_picture("extremes-relative", to_svg(plot));
}

TEST_F(Curves, RelativeErrorsOfCompositing) {
  Plot plot{"Relative errors in float32 of densities and transmittances", "log10 x", "log10 of the relative error", {}, true};
  constexpr double floor = floor_of_float32;
  {
    const std::vector<double> at = exponents(-3, 1.9, 0.1);
    std::vector<float> sdf, deltas;
    for (const double exponent : at) sdf.push_back(static_cast<float>(std::pow(10, exponent))), deltas.push_back(1e-3F);
    const std::vector<double> found = weights(DensityKind::laplace, sdf, deltas);
    std::vector<double> errors, plain, scaled;
    for (size_t i = 0; i < at.size(); ++i) {
      const long double density = std::exp(-static_cast<long double>(sdf[i])) / 2, truth = -std::expm1(-density * deltas[i]);
      errors.push_back(relative(found[i], truth)), plain.push_back(relative(0.5F - 0.5F * (1.0F - std::exp(-sdf[i])), density));
      scaled.push_back(errors.back() / (1 + double{sdf[i]}));
    }
    expect_within(Row::laplace_scale, Way::forward, "Laplace density outside, sdf/b from 1e-3 to 80", "relative error / (1 + sdf/b)", largest(scaled), float32_bound);
    plot.series.push_back(curve("Laplace density, x = sdf/b", at, errors, floor));
    plot.series.push_back(curve("as the paper writes it", at, plain, floor));
  }
  {
    SampleBatch batch = random_batch(1, 1000, 1);
    batch.metres_per_unit = 1;
    std::fill(batch.mask.begin(), batch.mask.end(), uint8_t(1)), std::fill(batch.sdf.begin(), batch.sdf.end(), 0.0F), std::fill(batch.deltas.begin(), batch.deltas.end(), 0.03F);
    const CompositedBatch found = run(batch, false), truth = composited_truth(batch, false);
    std::vector<double> at, errors, scaled;
    for (size_t k = 1; k < 1000; k = k < 20 ? k + 1 : k * 11 / 10) at.push_back(std::log10(static_cast<double>(k))), errors.push_back(relative(found.transmittances[k], truth.transmittances[k])), scaled.push_back(errors.back() / static_cast<double>(k));
    expect_within(Row::opaque_samples, Way::forward, "transmittance after k samples of density·δ = 0.015, k to 1,000", "relative error / k", largest(scaled), 5e-7);  // exp and a product: four units in the last place each
    plot.series.push_back(curve("transmittance, x samples", at, errors, floor));
  }
  keep_picture("extremes-compositing", to_svg(plot));
}

class AbsoluteCurves : public ActivationsOnDevice {};

TEST_F(AbsoluteCurves, ErrorsOfActivations) {
  Plot plot{"Errors of activations in float32", "log10 |x|", "log10 of the error", {}, true};
  constexpr double floor = 1e-12;
  const std::vector<double> at = exponents(-9, 6, 0.125);
  std::vector<float> x;
  for (const double sign : {1.0, -1.0})
    for (const double exponent : at) x.push_back(static_cast<float>(sign * std::pow(10, exponent)));
  const Activated soft = activate(Activation::softplus, x), sine = activate(Activation::sine, x);
  std::vector<double> soft_errors, slope_errors, sine_at, sine_errors, cosine_errors;
  for (size_t i = 0; i < at.size(); ++i) {
    double value = 0, slope = 0;
    for (const size_t k : {i, i + at.size()}) {  // of both signs the larger error
      const long double t = 100 * static_cast<long double>(x[k]), tail = std::exp(-std::abs(t));
      const double of_value = static_cast<double>(std::abs(soft.value[k] - (t > 20 ? t : std::max(t, 0.0L) + std::log1p(tail)) / 100));
      value = std::max(value, of_value / (1 + std::abs(double{x[k]})));
      slope = std::max(slope, static_cast<double>(std::abs(soft.slope[k] - (t > 20 ? 1 : (t > 0 ? 1 : tail) / (1 + tail)))));
    }
    soft_errors.push_back(value), slope_errors.push_back(slope);
    if (at[i] > 4) continue;
    sine_at.push_back(at[i]);
    sine_errors.push_back(static_cast<double>(std::abs(sine.value[i] - std::sin(static_cast<long double>(x[i])))));
    cosine_errors.push_back(static_cast<double>(std::abs(sine.slope[i] - std::cos(static_cast<long double>(x[i])))));
  }
  // Vulkan's log may be 2^-21 off near 1: 5e-9 over β.
  expect_within(Row::softplus, Way::forward, "softplus of ±x, x from 1e-9 to 1e6, against long double", "error / (1 + x)", largest(soft_errors), 1.3e-7);
  expect_within(Row::softplus, Way::backward, "softplus of ±x, x from 1e-9 to 1e6, against long double", "error of the slope", largest(slope_errors), float32_bound);
  expect_within(Row::sines, Way::forward, "x from 1e-9 to 1e4, against long double", "error of the sine", largest(sine_errors), 2e-7);
  expect_within(Row::sines, Way::backward, "x from 1e-9 to 1e4, against long double", "error of the slope", largest(cosine_errors), 2e-7);
  plot.series = {curve("softplus, β = 100, over 1 + |x|", at, soft_errors, floor), curve("its slope", at, slope_errors, floor), curve("sine", sine_at, sine_errors, floor), curve("its slope, the cosine", sine_at, cosine_errors, floor)};
  keep_picture("extremes-activations", to_svg(plot));
}

TEST(RotationCurves, ErrorsOfRodriguesFormula) {
  Plot plot{"Errors of Rodrigues' formula in double precision", "log10 of the angle, radians (the last at 10 π)", "log10 of the error", {}, true};
  constexpr double floor = 1e-18;
  std::vector<double> at = exponents(-12, 1.25, 0.125);
  at.push_back(std::log10(10 * std::acos(-1.0)));
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1, -2, 0.5)), g(0.4, 0.9, -0.2), arm(0.3, -0.7, 1.1);
  glm::dmat3 d_rotation;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) d_rotation[c][r] = g[r] * arm[c];
  std::vector<double> matrix, slope, plain, back;
  for (const double exponent : at) {
    const glm::dvec3 theta = std::pow(10, exponent) * axis;
    const glm::dmat3 rotation = rotation_from_axis_angle(theta), again = rotation_from_axis_angle(axis_angle_from_rotation(rotation));
    const Exact3x3 truth = exact_rotation(theta);
    double of_matrix = 0, of_slope = 0, of_return = 0;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) of_matrix = std::max(of_matrix, static_cast<double>(std::abs(rotation[c][r] - truth[static_cast<size_t>(r)][static_cast<size_t>(c)]))), of_return = std::max(of_return, std::abs(again[c][r] - rotation[c][r]));
    const glm::dvec3 found = axis_angle_gradient(theta, d_rotation);
    const std::array<long double, 3> exact = exact_slope(theta, g, arm);
    for (int k = 0; k < 3; ++k) of_slope = std::max(of_slope, static_cast<double>(std::abs(found[k] - exact[static_cast<size_t>(k)])));
    // What multiplies θ θᵀ in the slope, without series: (cos t − sin t / t) / t² and the like, times t².
    const double t = glm::length(theta);
    const long double b_along = exact_factors(t).b_along;
    plain.push_back(static_cast<double>(std::abs((std::sin(t) / t - 2 * ((1 - std::cos(t)) / (t * t))) / (t * t) - b_along) / std::abs(b_along)));
    matrix.push_back(of_matrix), slope.push_back(of_slope), back.push_back(of_return);
  }
  expect_within(Row::rotations, Way::forward, "Rodrigues' formula, angles from 1e-12 to 10 π", "error of the matrix", largest(matrix), 4e-15);
  expect_within(Row::rotations, Way::forward, "axis and angle, and back, angles from 1e-12 to 10 π", "error of the matrix", largest(back), 4e-15);
  expect_within(Row::rotations, Way::backward, "the slope of Rodrigues' formula, angles from 1e-12 to 10 π", "error", largest(slope), 1e-14);
  plot.series = {curve("R of an axis and angle", at, matrix, floor), curve("axis and angle of R, and back", at, back, floor), curve("slope", at, slope, floor), curve("one factor of the slope, plain", at, plain, floor)};
  keep_picture("extremes-rotations", to_svg(plot));
}

}  // namespace
}  // namespace arah
