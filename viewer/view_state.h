// What the viewer shows, as the hand left it: what is saved and reopened.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "viewer/comparison.h"
#include "viewer/pose_editor.h"
#include "viewer/timeline.h"
#include "viewer/viewpoint.h"

namespace arah {

struct ViewState {
  // Where one looks from.
  Viewpoint viewpoint;
  std::string camera;      // of the capture, by name: its view instead of the viewpoint's; empty: none
  double turntable = 0;    // turns of the viewpoint a minute, -60 to 60; 0: it stands

  // Which pose.
  Timeline timeline;
  PoseEdits edits;              // over the motion's pose
  double rest = 0;              // 0: the motion's pose, 1: the pose at rest, between them a blend
  std::vector<double> shape;    // β of the body, each -5 to 5; empty: the avatar's own
  std::optional<int> latent_frame;  // training frame whose code is shown; none: the frame's own, or as for an unseen one

  // What of it.
  std::string layer = "color";  // a name of host/evaluation/layers.h
  int joint = 0;                // of the layer "weights", and of the pose sliders
  double slice = 0;             // of the layer "slice": metres of the plane from the viewpoint's target towards the camera, -2 to 2
  bool skeleton = false;        // overlays
  bool outlines = false;        // of the template
  bool handles = false;         // joints can be dragged
  Comparison comparison;

  // How well.
  std::string quality = "balanced";  // preset that a picture at rest is refined to
  std::vector<std::pair<std::string, std::string>> knobs;  // of it, changed: set_render_knob()
  bool compare_with_exact = false;

  // The window.
  int width = 1120, height = 720;  // units of the system; 320 x 240 to 8192 x 8192
  bool hint_seen = false;          // of the first run

  bool operator==(const ViewState&) const = default;
};

// JSON with a field for each of these. Throws std::runtime_error where the disk refuses.
void write_view_state(const std::filesystem::path& path, const ViewState& state);
// Throws InputError naming file and field: not JSON, an unknown field, a wrong type, a value out of its range, a layer, preset or knob that
// there is not. Fields that are absent keep their defaults.
ViewState read_view_state(const std::filesystem::path& path);

}  // namespace arah
