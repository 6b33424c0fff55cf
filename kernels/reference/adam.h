// The optimiser (ARAH.md section 7, golden 10): Adam over groups of one flat parameter buffer, L2 weight decay (added
// to the gradient, not decoupled), clipping of each group's gradient norm, an average of the weights, and rate
// schedules.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace arah::reference {

struct AdamSettings {
  double beta1 = 0.9, beta2 = 0.999, epsilon = 1e-8;
};

// A slice of the flat buffers with its own rate.
struct AdamGroup {
  std::size_t offset = 0, count = 0;  // numbers
  double rate = 0;                    // learning rate of this step, after its schedule
  double weight_decay = 0;            // λ: the gradient becomes g + λ p, after clipping
  double max_gradient_norm = 0;       // g is scaled down to this 2-norm where longer; 0: no limit
};

// One step, `step` counted from 1, on the flat buffers [parameters]:
//   m = β₁ m + (1 − β₁) g,  v = β₂ v + (1 − β₂) g²,  p −= rate / (1 − β₁ᵗ) · m / (√(v / (1 − β₂ᵗ)) + ε).
// Returns each group's gradient norm before clipping. Where that is not finite the group is left as it is, moments and
// weights: one bad step does not destroy a run, and the caller sees it in the norm. Parameters in no group do not move.
std::vector<double> adam_step(std::span<double> parameters, std::span<const double> gradients, std::span<double> m,
                              std::span<double> v, std::span<const AdamGroup> groups, int step,
                              const AdamSettings& settings = {});

// Exponential moving average of the weights: average = decay · average + (1 − decay) · parameters.
void update_average(std::span<double> average, std::span<const double> parameters, double decay);

struct RateSchedule {
  enum class Decay { none, cosine, exponential };
  int freeze = 0;   // first steps with rate 0
  int warm_up = 0;  // steps of linear rise after that: 1/warm_up, 2/warm_up, … 1
  Decay decay = Decay::none;
  int total = 1;            // steps of the training, from 0 to the end of the decay
  double end_fraction = 1;  // factor at `total` and after; > 0 for exponential
};

// Factor on a group's learning rate at `step` (counted from 0): rise(step) · decay(step / total). The decay runs over
// the whole training whatever the freeze, so that groups that start at different times end together:
//   cosine: e + (1 − e)(1 + cos πp)/2,   exponential: e^p,   p = min(step / total, 1), e = end_fraction.
double rate_factor(const RateSchedule& schedule, int step);

}  // namespace arah::reference
