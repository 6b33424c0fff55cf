// What a capture, a motion or a template holds, and what looks wrong with it, in words.
#pragma once

#include <filesystem>
#include <string>

#include "host/body/body_template.h"
#include "host/body/motion.h"
#include "host/capture/capture.h"

namespace arah {

// The report on PATH: a capture (a folder), a motion (.json, .bvh, .npz, .pkl), cameras (cameras.json), a template or animations (.glb, .gltf). Lines
// that begin with "warning:" say what looks wrong. Throws InputError if the path is none of these or cannot be read at
// all.
std::string inspect(const std::filesystem::path& path);

std::string inspect_template(const BodyTemplate& body_template);
std::string inspect_motion(const Motion& motion);

// One camera's pictures of a split, as far as the template could be compared with their masks.
struct InspectedView {
  std::string split;
  std::size_t camera = 0;
  int frame = -1;                    // the one that fits worst, or the first; -1: there is no picture
  double inside = 0, least = 0;      // share of the vertices in view that lie in the mask: mean, and of that frame
  double overlap = 0;                // of silhouettes and masks, mean (diagnosis.h)
  std::vector<int> out_of_view;      // frames whose pictures show nothing of the template
  int measured = 0;                  // pictures; 0: none has both a mask and the template in view, the rest is unknown then
};

struct CaptureInspection {
  std::string report;  // lines
  std::vector<InspectedView> views;

  std::vector<std::string> warnings() const;  // of the report, without the word
};

// Reads pictures: of each split and camera up to `images_per_camera`, evenly spread, reduced to at most 512 columns.
// States per camera the share of projected template vertices that lie inside the mask grown by 3 pixels (clothes lie
// outside the body, so a right calibration gives close to 100 %), and the mistake that would explain a bad fit (diagnosis.h).
CaptureInspection examine_capture(const Capture& capture, int images_per_camera = 6);

// examine_capture's report.
std::string inspect_capture(const Capture& capture, int images_per_camera = 6);

}  // namespace arah
