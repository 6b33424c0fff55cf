// How fast the program is on this device: every kernel, and every stage of real work, against what the device can do at most
// (device_peak.h); the linear layer also beside OpenBLAS's sgemm on this machine's processor. The two are measured in turns,
// so that a busy machine slows them alike, and the best time of each counts; all other times are medians.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/evaluation/bench_line.h"
#include "host/evaluation/work_bench.h"

namespace arah {

struct BenchSettings {
  uint32_t points = 65536;                     // rows of a batch of linear layers; a multiple of 64, at most 65,536
  std::vector<uint32_t> widths{256, 128, 64};  // layers of width × width; multiples of 8, at most 512
  uint32_t repetitions = 5;                    // of each measurement of a kernel
  bool with_works = true;                      // pictures and training steps; most kernels are measured in these
  WorkBenchSettings works;
};

// One repetition of everything, on fewer points and smaller pictures: to see that all is there.
BenchSettings quick_bench_settings();

struct BenchResult {
  std::string device;
  std::string driver;
  std::string linear_family;  // "straight" or "tiled"
  int sgemm_threads = 0;
  DevicePeak peak;                 // the best of several measurements, before, between and after the others
  std::vector<BenchLine> lines;    // the products of the linear layer, beside sgemm
  std::vector<BenchLine> shaders;  // one line each, by name: in the first of the works that launches it, else alone
  std::vector<WorkBench> works;
};

// `progress` gets the name of each measurement before it starts. The device's profile is kept as it was. Throws InputError
// where a setting is out of range, and what measure_device_peak and run_work_bench throw.
BenchResult run_bench(Device& device, const BenchSettings& settings, const std::function<void(const std::string&)>& progress = {});

std::string bench_table(const BenchResult& result);
// {"kernels": {"device", "driver", "linear_family", "sgemm_threads", "peak": {"gflops", "gigabytes_per_second"}, "lines": [line],
// "shaders": [line]}, "works": [{"name", "description", "median_milliseconds", "mean_milliseconds", "profiled", "stages": [line],
// "launches": [line]}]} with line = {"name", "shape", "calls", "milliseconds", "gflops", "share_of_peak_arithmetic",
// "gigabytes_per_second", "share_of_peak_bandwidth", "sgemm_gflops", "share_of_sgemm"}; what does not apply to a line is absent.
std::string bench_json(const BenchResult& result);

// Two files of `arah bench --json`, line by line: milliseconds before and after, and after / before (below 1: faster). Lines
// that only one of them has are named. Files of version 0.1 have no shaders and no works but a "training_step", whose
// "stages" are its launches. Throws InputError naming `old_name` where the old text is no such file.
std::string bench_comparison(const std::string& old_json, const std::string& old_name, const std::string& new_json);

}  // namespace arah
