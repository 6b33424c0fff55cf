#include "host/evaluation/training_bench.h"

#include <fmt/format.h>
#include <stdlib.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>

#include "host/capture/synthetic_capture.h"
#include "host/training/template_fit.h"
#include "host/training/trainer.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (fs::temp_directory_path() / "arah-bench-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr)
      throw std::runtime_error(fmt::format("{}: could not be made: {}", name, std::strerror(errno)));
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

}  // namespace

TrainingBench run_training_bench(Device& device, const TrainingBenchSettings& settings) {
  if (settings.steps == 0) throw std::invalid_argument("training bench: no step to time");
  const TemporaryFolder folder;
  SyntheticSettings synthetic;
  synthetic.frames = 2;
  synthetic.size = 128;
  write_synthetic_capture(folder.path() / "capture", synthetic);
  const Capture capture = open_capture(folder.path() / "capture");

  TrainingSettings training = preset_settings("tiny");
  // Every group steps from the start, as in most of a training; and few steps of the fit are enough for searches that
  // converge as they do later.
  for (GroupSettings* group : {&training.sdf, &training.skinning}) group->freeze = group->warm_up = 0;
  training.fit_steps = 60;
  training.fit_skinning_steps = 200;
  Avatar avatar = make_avatar(preset_spec("tiny"), capture, 0);
  fit_template(device, avatar, training);
  Trainer trainer(device, capture, std::move(avatar), training);

  uint64_t left = uint64_t(settings.warm_up) + settings.steps + settings.profiled;
  for (uint32_t i = 0; i < settings.warm_up; ++i) trainer.step(left--);
  const bool profile_before = device.profiler().enabled;
  device.profiler().enabled = false;
  std::vector<double> milliseconds;
  for (uint32_t i = 0; i < settings.steps; ++i) {
    const auto start = std::chrono::steady_clock::now();
    trainer.step(left--);
    milliseconds.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  }

  TrainingBench bench;
  bench.preset = training.preset;
  bench.rays = training.rays;
  bench.samples = training.sampling.samples;
  bench.mean_milliseconds = std::accumulate(milliseconds.begin(), milliseconds.end(), 0.0) / settings.steps;
  std::nth_element(milliseconds.begin(), milliseconds.begin() + settings.steps / 2, milliseconds.end());
  bench.median_milliseconds = milliseconds[settings.steps / 2];
  if (device.report().timestamp_period_ns > 0 && settings.profiled > 0) {
    device.profiler().reset();
    device.profiler().enabled = true;
    for (uint32_t i = 0; i < settings.profiled; ++i) trainer.step(left--);
    bench.profiled = settings.profiled;
    bench.stages = profile_lines(device.profiler());
    device.profiler().reset();
  }
  device.profiler().enabled = profile_before;
  return bench;
}

std::string training_bench_table(const TrainingBench& bench) {
  std::string text =
      fmt::format("training step, preset {}, {} rays x {} samples: median {:.1f} ms, mean {:.1f} ms\n", bench.preset,
                  bench.rays, bench.samples, bench.median_milliseconds, bench.mean_milliseconds);
  if (bench.profiled == 0) return text + "the device has no timestamps: no times by stage\n";
  text += fmt::format("{:<48}{:>10}{:>12}{:>10}{:>9}\n", fmt::format("stage, of {} steps", bench.profiled),
                      "calls/step", "ms/step", "GFLOP/s", "GB/s");
  for (const BenchLine& line : bench.stages)
    text += fmt::format("{:<48}{:>10.2f}{:>12.3f}{:>10.2f}{:>9.2f}\n", line.name,
                        static_cast<double>(line.calls) / bench.profiled, line.milliseconds / bench.profiled,
                        line.gflops, line.gigabytes);
  return text;
}

std::string training_bench_json(const TrainingBench& bench) {
  nlohmann::ordered_json stages = nlohmann::json::array();
  for (const BenchLine& line : bench.stages)
    stages.push_back({{"name", line.name},
                      {"calls", line.calls},
                      {"milliseconds", line.milliseconds},
                      {"gflops", line.gflops},
                      {"gigabytes_per_second", line.gigabytes}});
  return nlohmann::ordered_json{{"preset", bench.preset},
                                {"rays", bench.rays},
                                {"samples", bench.samples},
                                {"median_milliseconds", bench.median_milliseconds},
                                {"mean_milliseconds", bench.mean_milliseconds},
                                {"profiled_steps", bench.profiled},
                                {"stages", stages}}
             .dump(1) +
         "\n";
}

}  // namespace arah
