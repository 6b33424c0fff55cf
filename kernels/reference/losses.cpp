#include "kernels/reference/losses.h"

#include <algorithm>
#include <cmath>

namespace arah::reference {

static double sign(double x) {
  return x > 0 ? 1 : x < 0 ? -1 : 0;
}

// 1 / (1 + exp(−x)), without overflow for either sign and exact in the tail that goes to 0.
static double sigmoid(double x) {
  if (x >= 0) return 1 / (1 + std::exp(-x));
  const double e = std::exp(x);
  return e / (1 + e);
}

ColorLoss color_loss(std::span<const Rgb> rendered, std::span<const Rgb> photograph,
                     std::span<const std::uint8_t> rendered_mask, double rays, std::span<const double> ray_weights) {
  ColorLoss loss{0, std::vector<Rgb>(rendered.size())};
  for (std::size_t i = 0; i < rendered.size(); ++i) {
    if (!rendered_mask[i]) continue;
    const double weight = ray_weights.empty() ? 1 : ray_weights[i];
    for (int c = 0; c < 3; ++c) {
      const double difference = rendered[i][c] - photograph[i][c];
      loss.value += weight * std::abs(difference) / rays;
      loss.gradient[i][c] = weight * sign(difference) / rays;
    }
  }
  return loss;
}

EikonalLoss eikonal_loss(std::span<const std::array<double, 3>> sdf_gradients, double rays) {
  EikonalLoss loss{0, std::vector<std::array<double, 3>>(sdf_gradients.size())};
  for (std::size_t i = 0; i < sdf_gradients.size(); ++i) {
    const auto& g = sdf_gradients[i];
    const double length = std::hypot(g[0], g[1], g[2]);
    loss.value += std::abs(length - 1) / rays;
    if (length == 0) continue;
    for (int c = 0; c < 3; ++c) loss.gradient[i][c] = sign(length - 1) * g[c] / length / rays;
  }
  return loss;
}

ScalarLoss off_surface_loss(std::span<const double> sdf, double rays) {
  ScalarLoss loss{0, std::vector<double>(sdf.size())};
  for (std::size_t i = 0; i < sdf.size(); ++i) {
    const double value = std::exp(-100 * sdf[i]) / rays;
    loss.value += value;
    loss.gradient[i] = -100 * value;
  }
  return loss;
}

ScalarLoss inside_loss(std::span<const double> sdf, double rays) {
  ScalarLoss loss{0, std::vector<double>(sdf.size())};
  for (std::size_t i = 0; i < sdf.size(); ++i) {
    const double x = 5000 * sdf[i];
    loss.value += sigmoid(x) / rays;
    loss.gradient[i] = 5000 * sigmoid(x) * sigmoid(-x) / rays;
  }
  return loss;
}

ScalarLoss on_surface_loss(std::span<const double> sdf, double points) {
  ScalarLoss loss{0, std::vector<double>(sdf.size())};
  for (std::size_t i = 0; i < sdf.size(); ++i) {
    loss.value += std::abs(sdf[i]) / points;
    loss.gradient[i] = sign(sdf[i]) / points;
  }
  return loss;
}

ScalarLoss near_zero_loss(std::span<const double> sdf, double points) {
  ScalarLoss loss{0, std::vector<double>(sdf.size())};
  for (std::size_t i = 0; i < sdf.size(); ++i) {
    const double value = std::exp(-100 * std::abs(sdf[i])) / points;
    loss.value += value;
    loss.gradient[i] = -100 * value * sign(sdf[i]);
  }
  return loss;
}

EikonalLoss normal_loss(std::span<const std::array<double, 3>> sdf_gradients, std::span<const std::array<double, 3>> normals, double points) {
  EikonalLoss loss{0, std::vector<std::array<double, 3>>(sdf_gradients.size())};
  for (std::size_t i = 0; i < sdf_gradients.size(); ++i) {
    const auto &g = sdf_gradients[i], &n = normals[i];
    const double length = std::hypot(g[0], g[1], g[2]);
    const double cosine = length == 0 ? 0 : (g[0] * n[0] + g[1] * n[1] + g[2] * n[2]) / length;
    loss.value += (1 - cosine) / points;
    if (length == 0) continue;
    // d cos / dg = (n − cos g/|g|) / |g|
    for (int c = 0; c < 3; ++c) loss.gradient[i][c] = -(n[c] - cosine * g[c] / length) / length / points;
  }
  return loss;
}

ScalarLoss skinning_loss(std::span<const double> weights, std::span<const double> template_weights, int bones) {
  ScalarLoss loss{0, std::vector<double>(weights.size())};
  const double points = static_cast<double>(weights.size()) / bones;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double difference = weights[i] - template_weights[i];
    loss.value += std::abs(difference) / points;
    loss.gradient[i] = sign(difference) / points;
  }
  return loss;
}

ScalarLoss parameter_loss(std::span<const double> parameters) {
  ScalarLoss loss{0, std::vector<double>(parameters.size())};
  const double count = static_cast<double>(parameters.size());
  double squares = 0;
  for (double p : parameters) squares += p * p;
  const double length = std::sqrt(squares);
  if (length == 0) return loss;
  loss.value = length / count;
  for (std::size_t i = 0; i < parameters.size(); ++i) loss.gradient[i] = parameters[i] / length / count;
  return loss;
}

ScalarLoss alpha_loss(std::span<const double> weights_sum, std::span<const double> mask, double rays,
                      std::span<const double> ray_weights) {
  constexpr double kClamp = 1e-3;
  ScalarLoss loss{0, std::vector<double>(weights_sum.size())};
  for (std::size_t i = 0; i < weights_sum.size(); ++i) {
    const double a = std::clamp(weights_sum[i], kClamp, 1 - kClamp);
    const double weight = ray_weights.empty() ? 1 : ray_weights[i];
    loss.value -= weight * (mask[i] * std::log(a) + (1 - mask[i]) * std::log1p(-a)) / rays;
    if (a == weights_sum[i]) loss.gradient[i] = weight * ((1 - mask[i]) / (1 - a) - mask[i] / a) / rays;
  }
  return loss;
}

MaskLoss mask_loss(std::span<const double> least_sdf, std::span<const double> mask, double alpha, double rays, std::span<const double> ray_weights) {
  const auto softplus = [](double x) { return std::max(x, 0.0) + std::log1p(std::exp(-std::abs(x))); };
  MaskLoss loss{0, std::vector<double>(least_sdf.size()), 0};
  for (std::size_t i = 0; i < least_sdf.size(); ++i) {
    const double f = least_sdf[i], x = alpha * f, weight = (ray_weights.empty() ? 1 : ray_weights[i]) / rays;
    const double value = (mask[i] * softplus(x) + (1 - mask[i]) * softplus(-x)) / alpha, slope = mask[i] * sigmoid(x) - (1 - mask[i]) * sigmoid(-x);
    loss.value += weight * value;
    loss.gradient[i] = weight * slope;
    loss.d_alpha += weight * (f * slope - value) / alpha;
  }
  return loss;
}

}  // namespace arah::reference
