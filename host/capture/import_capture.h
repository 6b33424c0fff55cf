// Makes captures in the native layout of sequences of public datasets (ARAH.md §8).
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "host/capture/dataset_presets.h"

namespace arah {

struct ImportSettings {
  std::string layout;                      // one of import_layouts()
  std::filesystem::path in, out;           // the sequence's folder; the folder to write
  std::filesystem::path body;              // .glb or .gltf, taken as it is; or SMPL's .npz or .pkl, in the sequence's shape
  std::string preset;                      // of dataset_presets(); empty: the one for the folder's name, if there is one
  std::vector<FrameRange> ranges;          // instead of a preset's; none and no preset: all frames train
  std::vector<std::string> train_cameras;  // instead of a preset's; all others are held out
  int size = 0;                            // columns that pictures are reduced to; 0: as they are
  int border = -1;                         // pixels on either side of the mask's edge that training leaves out; -1: as the preset says
  bool exact_poses = false;                // whether motion files call the poses exact; else estimated, and training refines them
};

struct ImportReport {
  std::string preset;  // that was taken; may be empty
  std::size_t pictures = 0;
  std::vector<std::string> notes;  // what a user should know: what was left out, and why
};

std::vector<std::string> import_layouts();

// Writes a capture to settings.out: cameras without distortion, lengths in metres, poses of the body's own rig, and pictures
// that are undistorted (bilinear; the mask by nearest pixels), cut out by their masks, and reduced by areas with K to match.
// Borders (capture.h) for training pictures where a band is asked for. import.json says how the capture was made and marks
// the folder as one that may be replaced; it appears under its name once it is complete.
// progress(done, total pictures), one call at a time; where it returns false the import ends with std::runtime_error.
// Throws InputError: a layout, preset, camera or frame that does not exist, files that are missing altogether, damaged or not
// as the layout says. Single pictures or bodies that are missing are left out and noted.
ImportReport import_capture(const ImportSettings& settings, const std::function<bool(std::size_t done, std::size_t total)>& progress = {});

}  // namespace arah
