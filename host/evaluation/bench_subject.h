// The small synthetic subject that benchmarks train on.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "host/avatar/avatar.h"
#include "host/capture/capture.h"
#include "host/training/training_settings.h"
#include "kernels/vulkan/device.h"

namespace arah {

// In a temporary folder for as long as it lives. Throws std::runtime_error where that cannot be written.
class BenchCapture {
 public:
  BenchCapture();
  ~BenchCapture();
  BenchCapture(const BenchCapture&) = delete;
  BenchCapture& operator=(const BenchCapture&) = delete;
  const Capture& capture() const { return capture_; }

 private:
  std::filesystem::path folder_;
  Capture capture_;
};

// A preset's, but every group steps from the start, as in most of a training.
TrainingSettings bench_step_settings(const std::string& preset, uint32_t fit_steps, uint32_t fit_skinning_steps);
// Fitted to the template; its pictures are sampled as in these settings.
Avatar bench_avatar(Device& device, const Capture& capture, const AvatarSpec& spec, const TrainingSettings& settings);

}  // namespace arah
