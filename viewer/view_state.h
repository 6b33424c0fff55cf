// All that a viewer shows and how, as a file: closed today, opened tomorrow as it was.
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/rendering/render_settings.h"
#include "viewer/comparison.h"
#include "viewer/pose_editor.h"
#include "viewer/timeline.h"
#include "viewer/viewpoint.h"

namespace arah {

struct ViewState {
  Viewpoint viewpoint;
  std::string camera;    // the capture's, by name, that is looked through; empty: the viewpoint
  double turntable = 0;  // radians a second, −2π to 2π; 0: it stands

  std::string split;  // of the capture; empty: a motion file, or rest
  Timeline timeline;

  std::optional<int> blend_frame;  // number of the frame whose pose is blended in
  double blend_weight = 0;         // 0 to 1

  std::map<std::string, glm::dvec3> turns;  // PoseEdits::turns by the joint's name, those that are not 0; radians, −100 to 100
  glm::dvec3 shift{0.0};                    // metres

  std::optional<int> latent_row;  // none: that of the frame
  std::vector<double> shape;      // of the body's morph targets, −100 to 100; empty: as the avatar has it

  std::string layer = "color";  // what is drawn
  std::string joint;            // that the layer is about, by name; empty: none

  double slice = 0;             // of the layer that cuts: metres from the viewpoint's target towards the camera, −2 to 2

  bool skeleton = false, mesh = false, handles = false;  // drawn over it; handles: joints to drag

  Comparison comparison;

  std::string quality = "balanced";          // one of render_presets()
  std::map<std::string, std::string> knobs;  // of render_knobs(), those that differ from the preset's
  bool compare_with_exact = false;           // the picture at rest is measured against "paper"

  int window_width = 1120, window_height = 720;  // 64 to 16384
  bool hint_seen = false;                        // the first run's

  bool operator==(const ViewState&) const = default;
};

inline constexpr std::size_t kMostViewFile = 1'000'000;  // bytes
inline constexpr std::size_t kLongestViewText = 1000;    // bytes of a name

// The file's text: JSON, {"arah_view": 1, "viewpoint": {…}, …}.
std::string view_state_json(const ViewState& state);
// Fields that are absent are as in ViewState{}. Throws InputError naming `where` and the field: no JSON, not of this version, fields that are not known,
// of another type, out of range, knobs and presets that there are not or whose values they do not take.
ViewState view_state_from_json(std::string_view text, const std::string& where);

// Throws InputError where the state could not be read again, and as write_file_safely() does.
void write_view_state(const std::filesystem::path& path, const ViewState& state);
// Throws InputError where there is no such file, or it is larger than kMostViewFile, and as view_state_from_json() does.
ViewState read_view_state(const std::filesystem::path& path);

// The edits of a skeleton's poses. Throws InputError naming `where` and a joint that the skeleton lacks.
PoseEdits edits_of(const ViewState& state, const Skeleton& skeleton, const std::string& where);
void set_edits(ViewState& state, const Skeleton& skeleton, const PoseEdits& edits);

// preset_with_knobs() (quality.h).
RenderSettings render_settings_of(const ViewState& state, const Avatar& avatar);

}  // namespace arah
