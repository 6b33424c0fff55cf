#include "kernels/reference/adam.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace arah::reference {

std::vector<double> adam_step(std::span<double> parameters, std::span<const double> gradients, std::span<double> m,
                              std::span<double> v, std::span<const AdamGroup> groups, int step,
                              const AdamSettings& settings) {
  const double correction1 = 1 - std::pow(settings.beta1, step);
  const double correction2 = 1 - std::pow(settings.beta2, step);
  std::vector<double> norms;
  for (const AdamGroup& group : groups) {
    double squares = 0;
    for (double g : gradients.subspan(group.offset, group.count)) squares += g * g;
    const double norm = std::sqrt(squares);
    norms.push_back(norm);
    if (!std::isfinite(norm)) continue;
    const bool clipped = group.max_gradient_norm > 0 && norm > group.max_gradient_norm;
    const double scale = clipped ? group.max_gradient_norm / norm : 1;
    for (std::size_t i = group.offset; i < group.offset + group.count; ++i) {
      const double g = scale * gradients[i] + group.weight_decay * parameters[i];
      m[i] = settings.beta1 * m[i] + (1 - settings.beta1) * g;
      v[i] = settings.beta2 * v[i] + (1 - settings.beta2) * g * g;
      parameters[i] -= group.rate / correction1 * m[i] / (std::sqrt(v[i] / correction2) + settings.epsilon);
    }
  }
  return norms;
}

void update_average(std::span<double> average, std::span<const double> parameters, double decay) {
  for (std::size_t i = 0; i < average.size(); ++i) average[i] += (1 - decay) * (parameters[i] - average[i]);
}

double rate_factor(const RateSchedule& schedule, int step) {
  if (step < schedule.freeze) return 0;
  const double rise = schedule.warm_up > 0 ? std::min(1.0, (step - schedule.freeze + 1.0) / schedule.warm_up) : 1.0;
  const double progress = std::min(1.0, static_cast<double>(step) / std::max(schedule.total, 1));
  double decay = 1;
  if (schedule.decay == RateSchedule::Decay::cosine)
    decay = schedule.end_fraction + (1 - schedule.end_fraction) * (1 + std::cos(std::numbers::pi * progress)) / 2;
  if (schedule.decay == RateSchedule::Decay::exponential) decay = std::pow(schedule.end_fraction, progress);
  return rise * decay;
}

}  // namespace arah::reference
