// How long a training step takes on this device, whole and by stage.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/evaluation/bench.h"

namespace arah {

struct TrainingBenchSettings {
  uint32_t steps = 30;     // that are timed, by the clock and without the profile
  uint32_t warm_up = 40;   // before them: pipelines, and the first look at every picture
  uint32_t profiled = 12;  // after them, for the stages
};

struct TrainingBench {
  std::string preset;
  uint32_t rays = 0, samples = 0;  // of a step
  double median_milliseconds = 0;  // of a step; every eighth one trains the skinning network and takes longer
  double mean_milliseconds = 0;    // of a step
  uint32_t profiled = 0;           // steps that `stages` cover; 0: the device has no timestamps
  std::vector<BenchLine> stages;   // by named launch, slowest first
};

// The preset `tiny` on a small synthetic capture that lives in a temporary folder for as long as this takes. Throws
// std::runtime_error where that folder cannot be written, std::invalid_argument for no step.
TrainingBench run_training_bench(Device& device, const TrainingBenchSettings& settings = {});

std::string training_bench_table(const TrainingBench& bench);
// {"preset", "rays", "samples", "median_milliseconds", "mean_milliseconds", "profiled_steps", "stages": [{"name",
// "calls", "milliseconds", "gflops", "gigabytes_per_second"}]}
std::string training_bench_json(const TrainingBench& bench);

}  // namespace arah
