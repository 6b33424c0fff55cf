// The viewer: one person in a window.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "host/cli/arguments.h"
#include "host/cli/motion_options.h"

namespace arah {

struct ViewerOptions {
  std::filesystem::path avatar;      // a file, or the folder of a run whose checkpoints are followed
  MotionOptions motion;
  std::string finest = "balanced";   // preset of a picture at rest
  int width = 1120, height = 720;    // of the window, in the system's units
  std::optional<double> measure;     // seconds: orbits by itself, prints times, and ends
  bool events = false;               // tells of itself in lines of JSON on standard output
  DeviceOptions device = DeviceOptions::from_environment();
};

// Returns the exit code when the window is closed. Throws InputError for files that do not fit, std::runtime_error where there is
// no display or the device fails.
int view(const ViewerOptions& options);

}  // namespace arah
