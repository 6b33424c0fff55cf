#include "host/training/rank_shares.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>

namespace arah {

std::vector<uint32_t> shares_by_speed(Device& device, const Capture& capture, const Avatar& avatar, const TrainingSettings& settings, const Ranks& ranks) {
  TrainingSettings alone = settings;
  alone.rays = std::max(settings.rays / ranks.count(), 64u);
  Trainer trainer(device, capture, avatar, alone);
  const uint64_t steps = 3;
  trainer.step(steps);
  ranks.wait_for_all();
  const auto start = std::chrono::steady_clock::now();
  for (uint64_t step = 1; step < steps; ++step) trainer.step(steps - step);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

  std::vector<double> times;
  for (const std::string& time : ranks.gather(std::to_string(seconds))) times.push_back(std::max(std::strtod(time.c_str(), nullptr), 1e-6));
  const double least = *std::min_element(times.begin(), times.end());
  std::vector<uint32_t> shares;
  for (const double time : times) shares.push_back(std::max(1u, static_cast<uint32_t>(std::lround(16 * least / time))));
  return shares;
}

}  // namespace arah
