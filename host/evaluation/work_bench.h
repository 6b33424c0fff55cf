// The program's real work, timed whole, by stage and by shader: training steps and pictures of a small synthetic subject.
// Their parts are chosen so that together they launch every shader that the program has a use for.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/evaluation/bench_line.h"

namespace arah {

struct WorkBenchSettings {
  // Of the training step: warm_up (pipelines, and the first look at every picture), then timed by the clock without the
  // profile, then profiled. Every eighth step also trains the skinning network.
  uint32_t warm_up = 40, steps = 30, profiled_steps = 16;
  uint32_t repetitions = 3;  // of the other works, each time by the clock and once more with the profile, after one to warm up
  int picture_size = 96;     // pixels, width and height
  // Of the avatars' fits to the template: enough for searches that converge as they do after a whole fit.
  uint32_t fit_steps = 60, fit_skinning_steps = 200;
};

struct WorkBench {
  std::string name;         // "training step"
  std::string description;  // what is computed, in plain words
  double median_milliseconds = 0, mean_milliseconds = 0;  // by the clock
  uint32_t profiled = 0;  // times that the lines stand for; 0: the device has no timestamps, and there are no lines
  // Of each, the time in which it has the median of its times: milliseconds, calls and rates of one picture or step, of
  // those that launch it at all.
  std::vector<BenchLine> stages;    // in order of the work
  std::vector<BenchLine> launches;  // by name, slowest first
  std::vector<BenchLine> shaders;   // by "<area>/<stem>"
};

// In this order: "training step" (preset tiny), "paper's step", "picture, paper", "picture, balanced", "picture, fast",
// "picture, template weights". `progress` gets the name of each before it starts. The capture lives in a temporary folder for as long as this
// takes. Throws std::runtime_error where that folder cannot be written, std::invalid_argument for no step.
std::vector<WorkBench> run_work_bench(Device& device, const WorkBenchSettings& settings = {}, const std::function<void(const std::string&)>& progress = {});

}  // namespace arah
