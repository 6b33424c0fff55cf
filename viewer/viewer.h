// The viewer: one person in a window.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "host/cli/arguments.h"
#include "host/cli/motion_options.h"

namespace arah {

struct ViewerOptions {
  std::filesystem::path avatar;        // a file, or the folder of a run; either is followed where it is written anew
  MotionOptions motion;
  bool split_given = false;            // motion.split is wanted whatever the state says
  std::filesystem::path state;         // to open with, where it is there, and to save to; empty: view.json in `out`, opened by no one
  std::filesystem::path out = ".";     // for screenshots, videos, meshes
  std::optional<std::string> quality;  // preset of a picture at rest, ahead of the state's
  std::optional<int> width, height;    // of the window, units of the system, ahead of the state's
  std::optional<double> measure;       // seconds: turns and plays by itself, prints times, and ends
  bool events = false;                 // tells of itself in lines of JSON on standard output
  DeviceOptions device = DeviceOptions::from_environment();
};

// Returns the exit code when the window is closed. Throws InputError for files that do not fit, std::runtime_error where there is
// no display or the device fails.
int view(const ViewerOptions& options);

}  // namespace arah
