// The panels beside the picture and the keys: they change the state, and wish for what only the viewer can do.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "viewer/scene.h"
#include "viewer/window.h"

namespace arah {

enum class Wish { screenshot, record, save_state, export_mesh, stop_job, front, quit };

// What the panels tell of.
struct PanelFacts {
  std::string title;
  const DrawnPicture* drawn = nullptr;
  std::string doing;     // of the worker
  JobState job;
  bool recording = false;
  std::string message;   // the last one
  std::string legend;    // of the layer
  std::optional<double> psnr;  // against the photograph
  double window_ms = 0;  // a frame of the window
};

class Panels {
 public:
  Panels(const Scene& scene, EditHistory& edits) : scene_(scene), edits_(edits) {}

  // Draws them from x = 0 on; width in ImGui's units. Returns what is wished for.
  std::vector<Wish> draw(ViewState& state, const PanelFacts& facts, float width, float height);
  // What a key does to the state. Nothing while a text is typed.
  std::vector<Wish> key(ViewState& state, const KeyPress& press);

  bool shows_stages() const { return shows_stages_; }  // the times of DrawnPicture::stages
  // Where the widgets of the last draw() are, by the words on them: their middle, ImGui's units. For tests that use a real hand.
  const std::map<std::string, std::pair<float, float>>& places() const { return places_; }

 private:
  void note(const std::string& name);
  void look(ViewState& state, std::vector<Wish>& wishes);
  void layers(ViewState& state, const PanelFacts& facts);
  void joint_choice(ViewState& state);
  void play(ViewState& state);
  void pose(ViewState& state);
  void quality(ViewState& state, const PanelFacts& facts);
  void keep(const PanelFacts& facts, std::vector<Wish>& wishes);
  void keys_window();

  const Scene& scene_;
  EditHistory& edits_;
  bool shows_keys_ = false, shows_stages_ = false;
  std::map<std::string, std::pair<float, float>> places_;
  char knob_[160] = "";
  std::string knob_error_;
};

}  // namespace arah
