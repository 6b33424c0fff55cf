// What each approximation of training costs and buys: the time of a step, and how far every parameter group's gradient is
// from the exact one.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/capture/capture.h"
#include "kernels/vulkan/device.h"

namespace arah {

struct TrainingTradeoffSettings {
  uint32_t rays = 0;         // of a step; 0: as the avatar was trained
  int size = 0;              // columns that pictures are reduced to; 0: as they are
  uint32_t repetitions = 3;  // steps that are timed, after the one whose gradient is compared
};

struct TrainingTradeoffPoint {
  std::string name;
  std::vector<std::pair<std::string, std::string>> changes;  // of the exact step: settings of a training's config.json
  double milliseconds = 0, fastest = 0, slowest = 0;         // of a step, the median
  double shaded = 0;                                         // share of the samples that got a colour
  double found = 0;                                          // share of the samples with a correspondence
  // By group that has parameters: |g − g_exact| / |g_exact| of the first step's gradient, in the Euclidean norm, before
  // clipping.
  std::vector<std::pair<std::string, double>> gradient_error;
};

struct TrainingTradeoff {
  std::vector<TrainingTradeoffPoint> points;  // "exact" first, "as trained" last
  std::string device, driver;
  uint32_t rays = 0, samples = 0;
};

// Steps from the avatar as it stands, with all groups free and its training's own sampling mode, losses and seed: the same
// rays and the same samples for every setting. Exact: every sample's correspondence searched to 1e-5 m within 50 steps, its
// distance and colour evaluated and its gradient passed on, wherever it lies. Throws InputError as training does.
TrainingTradeoff measure_training_tradeoff(Device& device, const Avatar& avatar, const Capture& capture, const TrainingTradeoffSettings& settings,
                                           const std::function<void(double, const std::string&)>& progress = {});

std::string training_tradeoff_csv(const TrainingTradeoff& tradeoff);
std::string training_tradeoff_table(const TrainingTradeoff& tradeoff);

}  // namespace arah
