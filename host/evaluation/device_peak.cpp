#include "host/evaluation/device_peak.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <stdexcept>

#include "host/evaluation/timed_launches.h"
#include "kernels/peak/arithmetic.h"
#include "kernels/peak/bandwidth.h"

namespace arah {
namespace {

constexpr uint64_t large_buffer_bytes = 128u << 20;  // the most that every device binds at once
constexpr uint32_t rounds_a_chain = 512, most_arithmetic_groups = 16384;
constexpr double long_enough_ms = 20;  // for starting the threads and the clock's grain not to count

void check_peak_result(const char* kernel, float found, double expected) {
  if (double(found) != expected) throw std::runtime_error(fmt::format("bench: the kernel '{}' wrote {} instead of {}: the device did not do its work", kernel, found, expected));
}

// Launches of more and more workgroups until they take long enough, then the best of the repetitions.
void find_arithmetic_peak(Commands& commands, uint32_t repetitions, DevicePeak& peak) {
  Device& device = commands.device();
  Buffer sums(device, "bench sums", 256ull * most_arithmetic_groups, BufferPlace::device);
  constexpr double chains = ArithmeticPeakArgs::chains, links = double(ArithmeticPeakArgs::links_a_round) * rounds_a_chain;
  const auto milliseconds_of = [&](uint32_t workgroups) {
    const ArithmeticPeakArgs args{workgroups, rounds_a_chain, 1, 1, sums.slice()};
    const TimedLaunches timed = run_timed(commands, [&] { record_arithmetic_peak(commands, args); });
    float last = 0;
    device.download(sums.slice().elements(64ull * workgroups - 1, 1), &last, 4);
    // Σ_k (k + 63 + links) of the last invocation
    check_peak_result("peak/arithmetic", last, chains * (63 + links) + chains * (chains - 1) / 2);
    return std::max(timed.milliseconds, 1e-6);
  };
  uint32_t workgroups = 64;
  while (milliseconds_of(workgroups) < long_enough_ms && workgroups < most_arithmetic_groups) workgroups *= 2;
  for (uint32_t i = 0; i < repetitions; ++i) {
    const double milliseconds = milliseconds_of(workgroups), gflops = 64.0 * workgroups * 2 * chains * links / milliseconds * 1e-6;
    if (gflops > peak.gflops) peak.gflops = gflops, peak.gflops_milliseconds = milliseconds;
  }
}

void find_bandwidth_peak(Commands& commands, uint32_t repetitions, DevicePeak& peak) {
  Device& device = commands.device();
  const uint64_t bytes = std::min(large_buffer_bytes, device.report().max_storage_buffer_bytes);
  Buffer rows(device, "bench rows", bytes, BufferPlace::device), sums(device, "bench sums", bytes, BufferPlace::device);
  commands.fill(rows.slice(), std::bit_cast<uint32_t>(1.0f));
  commands.submit_and_wait();
  for (const uint32_t reads : {1u, 16u}) {
    const auto workgroups = static_cast<uint32_t>(std::min<uint64_t>(bytes / (64 * 32 * reads), device.report().max_workgroups_x));
    const BandwidthPeakArgs args{workgroups, reads, rows.slice(), sums.slice()};
    for (uint32_t i = 0; i < repetitions + 1; ++i) {  // the first makes the pipeline and touches the memory
      const TimedLaunches timed = run_timed(commands, [&] { record_bandwidth_peak(commands, args); });
      float last = 0;
      device.download(sums.slice().elements(512ull * workgroups - 1, 1), &last, 4);
      check_peak_result("peak/bandwidth", last, reads);
      const double milliseconds = std::max(timed.milliseconds, 1e-6), gigabytes = 2048.0 * workgroups * (1 + reads) / milliseconds * 1e-6;
      if (i > 0 && gigabytes > peak.gigabytes) peak.gigabytes = gigabytes, peak.gigabytes_milliseconds = milliseconds;
    }
  }
}

}  // namespace

DevicePeak measure_device_peak(Device& device, uint32_t repetitions) {
  const ProfileScope profile(device);
  Commands commands(device);
  DevicePeak peak;
  find_arithmetic_peak(commands, repetitions, peak);
  find_bandwidth_peak(commands, repetitions, peak);
  return peak;
}

DevicePeak best_peak(const DevicePeak& a, const DevicePeak& b) {
  const DevicePeak &arithmetic = a.gflops > b.gflops ? a : b, &bandwidth = a.gigabytes > b.gigabytes ? a : b;
  return {arithmetic.gflops, bandwidth.gigabytes, arithmetic.gflops_milliseconds, bandwidth.gigabytes_milliseconds};
}

}  // namespace arah
