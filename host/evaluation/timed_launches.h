// Launches recorded, run and timed: by the device's own timestamps, or by the clock where it has none.
#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <vector>

#include "kernels/vulkan/commands.h"

namespace arah {

inline double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

// Of at least one value; the upper one of two in the middle.
inline double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

// Turns the profile on, empty, while it lives, and puts the caller's own back.
class ProfileScope {
 public:
  explicit ProfileScope(Device& device) : device_(device), before_(device.profiler()) {
    device.profiler() = {};
    device.profiler().enabled = device.report().timestamp_period_ns > 0;
  }
  ~ProfileScope() { device_.profiler() = before_; }
  ProfileScope(const ProfileScope&) = delete;
  ProfileScope& operator=(const ProfileScope&) = delete;

 private:
  Device& device_;
  Profiler before_;
};

struct TimedLaunches {
  double milliseconds = 0;
  Cost cost;         // of all; 0 without timestamps
  Profiler profile;  // what ran
};

// Runs what `record` records. Expects the profile on, as a ProfileScope leaves it. Timestamps do not count submission;
// the clock does.
inline TimedLaunches run_timed(Commands& commands, const std::function<void()>& record) {
  Profiler& profiler = commands.device().profiler();
  profiler.reset();
  record();
  const auto start = std::chrono::steady_clock::now();
  commands.submit_and_wait();
  TimedLaunches timed{milliseconds_since(start), {}, profiler};
  if (!profiler.enabled) return timed;
  timed.milliseconds = profiler.total_milliseconds();
  for (const auto& [name, launch] : profiler.launches()) {
    timed.cost.flops += launch.cost.flops;
    timed.cost.bytes += launch.cost.bytes;
  }
  return timed;
}

}  // namespace arah
