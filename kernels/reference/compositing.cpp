#include "kernels/reference/compositing.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace arah::reference {

std::vector<double> depth_differences(std::span<const double> depths, std::span<const std::uint8_t> mask, double last) {
  std::vector<double> deltas(depths.size(), 0);
  bool is_last = true;
  double next = 0;
  for (std::size_t i = depths.size(); i-- > 0;) {
    if (!mask[i]) continue;
    deltas[i] = is_last ? last : next - depths[i];
    next = depths[i];
    is_last = false;
  }
  return deltas;
}

Composite composite(const CompositingInput& input) {
  const std::size_t count = input.sdf.size();
  Composite result;
  result.density.resize(count);
  result.alpha.resize(count);
  result.weights.resize(count);
  result.transmittance.resize(count);
  double transmittance = 1;
  for (std::size_t i = 0; i < count; ++i) {
    result.transmittance[i] = transmittance;
    if (!input.mask[i]) continue;
    result.density[i] = density_of(input.density, input.sdf[i], input.b).value;
    result.alpha[i] = -std::expm1(-result.density[i] * input.deltas[i]);
    result.weights[i] = result.alpha[i] * transmittance;
    for (int c = 0; c < 3; ++c) result.colour[c] += result.weights[i] * input.rgb[i][c];
    result.depth += result.weights[i] * input.depths[i];
    transmittance *= 1 - result.alpha[i] + kTransmittanceFloor;
  }
  result.weights_sum = std::clamp(std::accumulate(result.weights.begin(), result.weights.end(), 0.0), 0.0, 1.0);
  return result;
}

std::vector<SampleGroup> group_samples(std::span<const double> weights, std::span<const std::array<double, 3>> points, std::size_t groups, double least_weight, double near) {
  double sum = 0;
  for (const double weight : weights) sum += weight > least_weight ? weight : 0;
  std::vector<SampleGroup> result;
  double before = 0;
  std::size_t group = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] <= least_weight) continue;
    const auto at = std::min(static_cast<std::size_t>((before + 0.5 * weights[i]) / sum * static_cast<double>(groups)), groups - 1);
    const auto far = [&](const std::array<double, 3>& from) { return std::hypot(points[i][0] - from[0], points[i][1] - from[1], points[i][2] - from[2]) > near; };
    if (result.empty() || at != group || far(points[result.back().first])) result.push_back({i, 0, {}});
    group = at;
    result.back().weight += weights[i];
    for (std::size_t c = 0; c < 3; ++c) result.back().point[c] += weights[i] * points[i][c];
    before += weights[i];
  }
  for (SampleGroup& one : result)
    for (double& x : one.point) x /= one.weight;
  return result;
}

CompositingGradient composite_backward(const CompositingInput& input, const Composite& forward,
                                       const std::array<double, 3>& colour_gradient, double weights_sum_gradient) {
  const std::size_t count = input.sdf.size();
  CompositingGradient gradient{std::vector<double>(count, 0), std::vector<std::array<double, 3>>(count), 0};
  const double sum = std::accumulate(forward.weights.begin(), forward.weights.end(), 0.0);
  const double through_clip = sum >= 0 && sum <= 1 ? weights_sum_gradient : 0;
  double behind = 0;  // A_{i+1}
  for (std::size_t i = count; i-- > 0;) {
    if (!input.mask[i]) continue;
    double of_weight = through_clip;
    for (int c = 0; c < 3; ++c) {
      gradient.rgb[i][c] = colour_gradient[c] * forward.weights[i];
      of_weight += colour_gradient[c] * input.rgb[i][c];
    }
    const double of_alpha = forward.transmittance[i] * (of_weight - behind);
    behind = of_weight * forward.alpha[i] + (1 - forward.alpha[i] + kTransmittanceFloor) * behind;
    const double of_density = of_alpha * input.deltas[i] * std::exp(-forward.density[i] * input.deltas[i]);
    const Density density = density_of(input.density, input.sdf[i], input.b);
    gradient.sdf[i] = of_density * density.d_sdf;
    gradient.b += of_density * density.d_b;
  }
  return gradient;
}

}  // namespace arah::reference
