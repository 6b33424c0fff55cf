// How good an avatar is after so many minutes of training: of the avatars that runs kept on their way (`arah train --keep`),
// how near pictures and surface come. A field that scores well and is rough is no gain, so both stand side by side.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/capture/capture.h"
#include "kernels/vulkan/device.h"

namespace arah {

struct LearningCurveSettings {
  int every = 1;  // takes every so-many-th frame that has a picture, camera by camera
  int size = 0;   // columns that photographs are reduced to; 0: as they are
};

struct LearningCurvePoint {
  std::string run;     // the folder's name
  double minutes = 0;  // of training, the start included
  uint64_t steps = 0;
  std::optional<double> views;    // mean PSNR, dB: the training's frames from held-out cameras
  std::optional<double> motion;   // mean PSNR, dB: the split `novel` from held-out cameras, where the capture has it
  std::optional<double> surface;  // mean distance of the true surface, metres: of `novel`, where the capture has its meshes
};

// By run, then minutes. Throws InputError naming a run that kept no avatar, and as evaluate does.
std::vector<LearningCurvePoint> learning_curve(Device& device, const Capture& capture, const std::vector<std::filesystem::path>& runs, const LearningCurveSettings& settings,
                                               const std::function<bool(double)>& progress = {});

// run,minutes,steps,psnr_views,psnr_motion,surface_mm; what was not measured is empty.
std::string learning_curve_csv(const std::vector<LearningCurvePoint>& points);
// A page with the PSNR of both over minutes, and below it the surface's error.
std::string learning_curve_page(const std::vector<LearningCurvePoint>& points, const Capture& capture, const Device& device);

}  // namespace arah
