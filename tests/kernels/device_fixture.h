// The device that kernel tests run on: one for the whole program, with the validation layer and its synchronisation checks.
#pragma once

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "kernels/vulkan/commands.h"
#include "kernels/vulkan/device.h"

namespace arah {

// No usable device is an error, never a pass: the constructor throws and the test fails.
inline Device& test_device() {
  static Device device([] {
    DeviceOptions options = DeviceOptions::from_environment();
    options.validation = true;
    return options;
  }());
  return device;
}

// Fails the test that caused any message of the validation layer.
class DeviceTest : public testing::Test {
 protected:
  Device& device = test_device();
  Commands commands{device};
  std::mt19937_64 generator{20240607};

  void TearDown() override {
    const std::vector<std::string> messages = device.validation_messages();
    for (; reported_ < messages.size(); ++reported_) ADD_FAILURE() << "validation layer: " << messages[reported_];
  }

  std::vector<float> uniform(size_t count, double low = -1, double high = 1) {
    std::uniform_real_distribution<double> distribution(low, high);
    std::vector<float> values(count);
    for (float& value : values) value = static_cast<float>(distribution(generator));
    return values;
  }
  template <typename T>
  Buffer filled(const std::string& name, const std::vector<T>& values, uint64_t at_least_bytes = 0) {
    Buffer buffer(device, name, std::max<uint64_t>(values.size() * sizeof(T), std::max<uint64_t>(at_least_bytes, 256)), BufferPlace::device);
    device.upload(buffer.slice(), values);
    return buffer;
  }
  Buffer empty(const std::string& name, uint64_t bytes) { return Buffer(device, name, bytes, BufferPlace::device); }

 private:
  static inline size_t reported_ = 0;
};

}  // namespace arah
