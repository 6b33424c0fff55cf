// How fast the kernels are on this device, with OpenBLAS's sgemm on this machine's processor as the yardstick of the
// linear layer: both are measured in turns, so that a busy machine slows them alike, and the best time of each counts.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace arah {

class Device;
class Profiler;

struct BenchSettings {
  uint32_t points = 65536;                     // rows of a batch; a multiple of 64, at most 65,536
  std::vector<uint32_t> widths{256, 128, 64};  // layers of width × width; multiples of 8, at most 512
  uint32_t repetitions = 5;                    // of each measurement
};

struct BenchLine {
  std::string name;         // of the kernel, in plain words
  std::string shape;        // "65536 x 256 x 256"; empty where the line comes from a profile
  uint64_t calls = 1;       // launches that `milliseconds` covers
  double milliseconds = 0;  // the best repetition; of a profile: all calls together
  double gflops = 0;        // 10^9 operations a second, as the kernel's own formula counts them; 0 where it counts none
  double gigabytes = 0;     // 10^9 bytes a second, likewise
  double sgemm_gflops = 0;  // of the same product; 0 where there is no such product
  double share_of_sgemm() const { return sgemm_gflops > 0 ? gflops / sgemm_gflops : 0; }
};

struct BenchResult {
  std::string device;
  std::string driver;
  std::string linear_family;  // "straight" or "tiled"
  int sgemm_threads = 0;
  std::vector<BenchLine> lines;
};

// Measures forward, input gradient and weight gradient of the linear layer at every width, then the kernels of the
// colour network's inputs. `progress` gets each line when it is there. The device's profile is kept as it was. Throws
// InputError where a setting is out of range.
BenchResult run_bench(Device& device, const BenchSettings& settings,
                      const std::function<void(const BenchLine&)>& progress = {});

// One line a named launch of a profile, slowest first: how kernels did in real work, such as a training step.
std::vector<BenchLine> profile_lines(const Profiler& profiler);

std::string bench_table(const BenchResult& result);
// {"device", "driver", "linear_family", "sgemm_threads", "lines": [{"name", "shape", "calls", "milliseconds", "gflops",
// "gigabytes_per_second", "sgemm_gflops", "share_of_sgemm"}]}; what does not apply to a line is absent from it.
std::string bench_json(const BenchResult& result);

// Two files of `arah bench --json`, line by line: milliseconds before and after, and after / before (below 1: faster). Lines
// that only one of them has are named. Throws InputError naming `old_name` where the old text is no such file.
std::string bench_comparison(const std::string& old_json, const std::string& old_name, const std::string& new_json);

}  // namespace arah
