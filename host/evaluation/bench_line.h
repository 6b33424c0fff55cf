// One line of the bench: a kernel, a launch or a stage with its time and its rates.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/evaluation/device_peak.h"
#include "kernels/vulkan/device.h"

namespace arah {

struct BenchLine {
  std::string name;         // of the kernel, in plain words; of a shader "<area>/<stem>"
  std::string shape;        // "65536 x 256 x 256", or the work in which it was measured, "training step"
  uint64_t calls = 1;       // launches that `milliseconds` covers
  double milliseconds = 0;  // all calls together
  double gflops = 0;        // 10^9 operations a second, as the kernel's own formula counts them; 0 where it counts none
  double gigabytes = 0;     // 10^9 bytes a second, likewise
  double sgemm_gflops = 0;  // of the same product; 0 where there is no such product

  double share_of_sgemm() const { return sgemm_gflops > 0 ? gflops / sgemm_gflops : 0; }
  // Of what the device can do; the larger of the two is what bounds the kernel. 0 where the peak is unknown.
  double share_of_arithmetic(const DevicePeak& peak) const { return peak.gflops > 0 ? gflops / peak.gflops : 0; }
  double share_of_bandwidth(const DevicePeak& peak) const { return peak.gigabytes > 0 ? gigabytes / peak.gigabytes : 0; }
};

BenchLine bench_line(const std::string& name, const std::string& shape, const LaunchStatistics& statistics);

// One line an entry of Profiler::launches, shaders or stages, by name: of the profiles that have it, the one with the median
// time (of two, the slower).
using ProfileEntries = const std::map<std::string, LaunchStatistics>& (Profiler::*)() const;
std::vector<BenchLine> median_lines(const std::vector<Profiler>& profiles, ProfileEntries entries, const std::string& shape);

}  // namespace arah
