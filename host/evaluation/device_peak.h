// What this device can do at most, measured on it: the yardstick of every kernel (docs/decisions/device-peak.md).
#pragma once

#include <cstdint>

namespace arah {

class Device;

struct DevicePeak {
  double gflops = 0;     // 10^9 operations a second in float32, a multiply-add counted as two
  double gigabytes = 0;  // 10^9 bytes a second between the device and buffers far larger than its caches
  double gflops_milliseconds = 0, gigabytes_milliseconds = 0;  // of the launches that showed it
};

// The best of the repetitions of each: independent multiply-adds in registers; copying, and reading alone. Throws
// std::runtime_error where a result shows that the work was not done.
DevicePeak measure_device_peak(Device& device, uint32_t repetitions);
// The better of the two in each: what a busy machine slowed down once, it may not the next time.
DevicePeak best_peak(const DevicePeak& a, const DevicePeak& b);

}  // namespace arah
