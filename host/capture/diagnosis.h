// Why a capture's template does not fall into its masks: mistakes that are often made with calibrations, poses and masks are
// undone one at a time, and the one whose undoing helps is named.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "host/capture/capture.h"

namespace arah {

// The mask of one picture, reduced to at most kDiagnosisWidth columns.
struct SeenMask {
  std::string split;
  std::size_t frame = 0;  // index into the motion's frames
  std::size_t camera = 0;
  PixelMask mask;
};
inline constexpr int kDiagnosisWidth = 128;

// How well the posed template fits masks, means over pictures, 0..1.
struct Agreement {
  double inside = 0;   // share of all its vertices that fall into the mask grown by a pixel; those out of view do not
  double overlap = 0;  // of its silhouette and the mask: intersection over union. Clothes keep that below 1
};

struct Diagnosis {
  std::string of;      // whose pictures: "all pictures", "split novel", "camera cam_03, cam_04"
  std::string cause;   // "the pictures are mirrored, left to right"
  std::string undone;  // what was tried, for "with …": "R transposed"
  Agreement before, after;
  std::string split;                 // the one that it is about; empty: all
  std::vector<std::size_t> cameras;  // those that it is about; empty: all

  bool covers(const std::string& of_split, std::size_t camera) const;
};

// How the capture is as it stands, one for each of the masks.
std::vector<Agreement> agreements(const Capture& capture, std::span<const SeenMask> masks);

// before: agreements(). Looks for one cause of all pictures, else for one a split, else for one a camera. A cause is taken
// where undoing it puts at least 0.9 of the template into the masks and lifts the overlap to at least 0.4, by at least 0.05
// and a quarter of what lacked to 1, better in at least 70 % of the pictures and worse by more than 0.1 in at most 10 %: nothing is said of a capture that is
// right, and nothing of one whose fault is none of these: lengths in millimetres or centimetres; R, T or both from the camera
// to the world; OpenGL's camera axes; axes of the world swapped or mirrored between cameras and motion; a left-handed
// calibration; mirrored pictures; intrinsics of another picture size; inverted masks; pictures up to 8 frames ahead of the
// poses or behind them. Leave out masks that are empty or full: nothing can be said of them.
std::vector<Diagnosis> diagnose(const Capture& capture, std::span<const SeenMask> masks, std::span<const Agreement> before);

// "all pictures: R of … . As it is, 3 % of the template lies in the masks and their silhouettes overlap by 1 %; with R transposed, 97 % and 80 %"
std::string describe(const Diagnosis& diagnosis);

}  // namespace arah
