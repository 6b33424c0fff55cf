#include "viewer/panels.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "host/evaluation/layers.h"
#include "host/input_error.h"
#include "host/rendering/render_settings.h"

namespace arah {
namespace {

constexpr double kTurntable = std::numbers::pi / 5;  // radians a second: a turn in ten seconds
constexpr float kDegrees = static_cast<float>(180 / std::numbers::pi);

// The key and what it does, in the order in which the list shows them.
constexpr std::array<std::pair<const char*, const char*>, 25> kKeys{{
    {"drag", "turn"},
    {"shift + drag, right drag", "move"},
    {"wheel", "nearer, farther"},
    {"F", "look from the front"},
    {"T", "turntable: start, stop"},
    {"C, shift + C", "next, last camera of the capture"},
    {"V", "back from a camera to the free view"},
    {"B", "photograph: behind, blink, split, error, off"},
    {"L, shift + L", "next, last layer"},
    {"K", "skeleton"},
    {"O", "outlines of the template"},
    {"space", "play, pause"},
    {"left, right", "one frame back, on"},
    {"up, down", "faster, slower"},
    {"J", "joints to drag"},
    {"ctrl + Z, ctrl + Y", "undo, redo what was done to the pose"},
    {"X", "pose as the motion has it"},
    {"1 2 3 4", "paper, balanced, fast, preview"},
    {"E", "error of the picture against the exact one"},
    {"S", "screenshot"},
    {"M", "video: start, stop"},
    {"P", "mesh of this pose (.ply)"},
    {"ctrl + S", "save what is seen"},
    {"?", "this list"},
    {"ctrl + Q", "end"},
}};

template <typename T>
T next_of(const std::vector<T>& all, const T& now, int step) {
  const auto found = std::find(all.begin(), all.end(), now);
  const auto count = static_cast<std::ptrdiff_t>(all.size());
  const std::ptrdiff_t at = found == all.end() ? (step > 0 ? -1 : 0) : found - all.begin();
  return all[static_cast<size_t>(((at + step) % count + count) % count)];
}

std::vector<std::string> layer_names() {
  std::vector<std::string> names;
  for (const PictureLayer layer : all_layers()) names.emplace_back(to_string(layer));
  return names;
}

// ImGui's own font has no more: the minus of text becomes a hyphen, times an x, the rest stays.
std::string in_ascii(std::string text) {
  for (const auto& [from, to] : {std::pair{"\u2212", "-"}, std::pair{"\u00d7", "x"}, std::pair{"\u00b0", " deg"}})
    for (size_t at = 0; (at = text.find(from, at)) != std::string::npos;) text.replace(at, std::string(from).size(), to);
  return text;
}

const std::vector<ComparisonMode> kModes{ComparisonMode::off, ComparisonMode::behind, ComparisonMode::blink, ComparisonMode::split, ComparisonMode::error_map};

}  // namespace

void Panels::note(const std::string& name) {
  const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
  places_[name] = {0.5f * (low.x + high.x), 0.5f * (low.y + high.y)};
}

std::vector<Wish> Panels::key(ViewState& state, const KeyPress& press) {
  if (ImGui::GetIO().WantTextInput) return {};
  if (press.control) {
    switch (press.key) {
      case GLFW_KEY_Q: return {Wish::quit};
      case GLFW_KEY_S: return {Wish::save_state};
      case GLFW_KEY_Z: edits_.undo(); return {};
      case GLFW_KEY_Y: edits_.redo(); return {};
      default: return {};
    }
  }
  const Motion& motion = scene_.motion();
  // Held down, these go on.
  if (press.key == GLFW_KEY_RIGHT) state.timeline = stepped(state.timeline, motion, 1);
  if (press.key == GLFW_KEY_LEFT) state.timeline = stepped(state.timeline, motion, -1);
  if (press.repeated) return {};

  const int step = press.shift ? -1 : 1;
  switch (press.key) {
    case GLFW_KEY_F: return {Wish::front};
    case GLFW_KEY_S: return {Wish::screenshot};
    case GLFW_KEY_M: return {Wish::record};
    case GLFW_KEY_P: return {Wish::export_mesh};
    case GLFW_KEY_T: state.turntable = state.turntable == 0 ? kTurntable : 0; break;
    case GLFW_KEY_C: {
      std::vector<std::string> names;
      for (const Camera& camera : scene_.cameras()) names.push_back(camera.name);
      if (!names.empty()) state.camera = next_of(names, state.camera, step);
      break;
    }
    case GLFW_KEY_V: state.camera.clear(); break;
    case GLFW_KEY_B: state.comparison.mode = next_of(kModes, state.comparison.mode, step); break;
    case GLFW_KEY_L: state.layer = next_of(layer_names(), state.layer, step); break;
    case GLFW_KEY_K: state.skeleton = !state.skeleton; break;
    case GLFW_KEY_O: state.mesh = !state.mesh; break;
    case GLFW_KEY_J: state.handles = !state.handles && scene_.posable(); break;
    case GLFW_KEY_X: edits_.change({}); break;
    case GLFW_KEY_E: state.compare_with_exact = !state.compare_with_exact; break;
    case GLFW_KEY_SPACE:
      if (state.timeline.playing) state.timeline.playing = false;
      else state.timeline = played(state.timeline, motion);
      break;
    case GLFW_KEY_UP: state.timeline.speed = std::min(kFastest, 2 * state.timeline.speed); break;
    case GLFW_KEY_DOWN: state.timeline.speed = std::max(kSlowest, 0.5 * state.timeline.speed); break;
    case GLFW_KEY_ESCAPE: shows_keys_ = false; break;
    default: {
      const auto preset = static_cast<size_t>(press.key - GLFW_KEY_1);
      if (press.key < GLFW_KEY_1 || preset >= render_presets().size()) break;
      ViewState other = state;
      other.quality = render_presets()[preset];
      other.knobs.clear();
      state = scene_.fitting(other);
    }
  }
  return {};
}

std::vector<Wish> Panels::draw(ViewState& state, const PanelFacts& facts, float width, float height) {
  std::vector<Wish> wishes;
  places_.clear();
  ImGui::SetNextWindowPos({0, 0});
  ImGui::SetNextWindowSize({width, height});
  ImGui::Begin("panel", nullptr, ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoBringToFrontOnFocus);
  ImGui::TextUnformatted(facts.title.c_str());
  ImGui::TextDisabled("%s", facts.doing.empty() ? "at rest" : facts.doing.c_str());
  ImGui::PushItemWidth(0.6f * width);
  if (ImGui::CollapsingHeader("View", ImGuiTreeNodeFlags_DefaultOpen)) look(state, wishes);
  if (ImGui::CollapsingHeader("Layer", ImGuiTreeNodeFlags_DefaultOpen)) layers(state, facts);
  if (scene_.motion().frames.size() > 1 && ImGui::CollapsingHeader("Motion", ImGuiTreeNodeFlags_DefaultOpen)) play(state);
  if (scene_.posable()) {
    const bool open = ImGui::CollapsingHeader("Pose and shape");
    note("Pose and shape");
    if (open) pose(state);
  }
  shows_stages_ = ImGui::CollapsingHeader("Quality");
  note("Quality");
  if (shows_stages_) quality(state, facts);
  if (ImGui::CollapsingHeader("Keep", ImGuiTreeNodeFlags_DefaultOpen)) keep(facts, wishes);
  ImGui::PopItemWidth();
  ImGui::Separator();
  if (!facts.message.empty()) ImGui::TextWrapped("%s", in_ascii(facts.message).c_str());
  ImGui::TextDisabled("? lists the keys");
  ImGui::End();
  // The letter, not a key: it lies elsewhere on every keyboard.
  if (!ImGui::GetIO().WantTextInput)
    for (const ImWchar letter : ImGui::GetIO().InputQueueCharacters)
      if (letter == '?') shows_keys_ = !shows_keys_;
  if (shows_keys_) keys_window();
  return wishes;
}

void Panels::look(ViewState& state, std::vector<Wish>& wishes) {
  if (ImGui::Button("front")) wishes.push_back(Wish::front);
  note("front");
  ImGui::SameLine();
  bool turning = state.turntable != 0;
  if (ImGui::Checkbox("turntable", &turning)) state.turntable = turning ? kTurntable : 0;
  note("turntable");
  if (turning) {
    auto degrees = static_cast<float>(state.turntable) * kDegrees;
    if (ImGui::SliderFloat("degrees a second", &degrees, -180, 180, "%.0f") && degrees != 0) state.turntable = double(degrees / kDegrees);
  }
  if (scene_.cameras().empty()) return;
  if (ImGui::BeginCombo("camera", state.camera.empty() ? "free view" : state.camera.c_str())) {
    if (ImGui::Selectable("free view", state.camera.empty())) state.camera.clear();
    for (const Camera& camera : scene_.cameras())
      if (ImGui::Selectable(camera.name.c_str(), camera.name == state.camera)) state.camera = camera.name;
    ImGui::EndCombo();
  }
  if (state.camera.empty()) return;
  if (ImGui::BeginCombo("photograph", to_string(state.comparison.mode))) {
    for (const ComparisonMode mode : kModes)
      if (ImGui::Selectable(to_string(mode), mode == state.comparison.mode)) state.comparison.mode = mode;
    ImGui::EndCombo();
  }
  const auto slider = [](const char* name, double& value, double low, double high) {
    auto number = static_cast<float>(value);
    if (ImGui::SliderFloat(name, &number, static_cast<float>(low), static_cast<float>(high), "%.2f")) value = std::clamp(double{number}, low, high);
  };
  if (state.comparison.mode == ComparisonMode::split) slider("split", state.comparison.position, 0, 1);
  if (state.comparison.mode == ComparisonMode::blink) slider("seconds", state.comparison.period, kShortestBlink, kLongestBlink);
  if (state.comparison.mode == ComparisonMode::error_map) slider("gain", state.comparison.gain, kLeastErrorGain, kLargestErrorGain);
}

void Panels::layers(ViewState& state, const PanelFacts& facts) {
  if (ImGui::BeginCombo("layer", state.layer.c_str())) {
    for (const std::string& name : layer_names())
      if (ImGui::Selectable(name.c_str(), name == state.layer)) state.layer = name;
    ImGui::EndCombo();
  }
  note("layer");
  if (state.layer == to_string(PictureLayer::slice)) {
    auto slice = static_cast<float>(state.slice);
    if (ImGui::SliderFloat("metres nearer", &slice, -2, 2, "%.2f")) state.slice = std::clamp(double{slice}, -2.0, 2.0);
  }
  if (state.layer == to_string(PictureLayer::weights)) joint_choice(state);
  if (!facts.legend.empty()) ImGui::TextWrapped("%s", in_ascii(facts.legend).c_str());
  ImGui::Checkbox("skeleton", &state.skeleton);
  note("skeleton");
  ImGui::SameLine();
  ImGui::Checkbox("template", &state.mesh);
  if (facts.psnr) ImGui::Text("%.2f dB against the photograph", *facts.psnr);
}

void Panels::joint_choice(ViewState& state) {
  if (ImGui::BeginCombo("joint", state.joint.c_str())) {
    for (const std::string& name : scene_.motion().skeleton.names)
      if (ImGui::Selectable(name.c_str(), name == state.joint)) state.joint = name;
    ImGui::EndCombo();
  }
  note("joint");
}

void Panels::play(ViewState& state) {
  const Motion& motion = scene_.motion();
  if (ImGui::Button(state.timeline.playing ? "pause" : "play")) {
    if (state.timeline.playing) state.timeline.playing = false;
    else state.timeline = played(state.timeline, motion);
  }
  note("play");
  ImGui::SameLine();
  ImGui::Text("frame %d, %.2f s", scene_.frame_number(state), scene_.seconds_of(state));
  auto place = static_cast<float>(state.timeline.place);
  if (ImGui::SliderFloat("frame", &place, 0, static_cast<float>(motion.frames.size() - 1), "%.1f")) state.timeline = scrubbed(state.timeline, motion, double{place});
  note("frame");
  auto speed = static_cast<float>(state.timeline.speed);
  if (ImGui::SliderFloat("speed", &speed, static_cast<float>(kSlowest), static_cast<float>(kFastest), "%.2f", ImGuiSliderFlags_Logarithmic)) state.timeline.speed = std::clamp(double{speed}, kSlowest, kFastest);
  if (ImGui::BeginCombo("loop", to_string(state.timeline.loop))) {
    for (const Loop loop : {Loop::around, Loop::once, Loop::there_and_back})
      if (ImGui::Selectable(to_string(loop), loop == state.timeline.loop)) state.timeline.loop = loop;
    ImGui::EndCombo();
  }
}

void Panels::pose(ViewState& state) {
  const Skeleton& skeleton = scene_.motion().skeleton;
  ImGui::Checkbox("drag joints", &state.handles);
  note("drag joints");
  ImGui::SameLine();
  if (ImGui::Button("undo")) edits_.undo();
  ImGui::SameLine();
  if (ImGui::Button("redo")) edits_.redo();
  joint_choice(state);
  const auto joint = static_cast<size_t>(std::find(skeleton.names.begin(), skeleton.names.end(), state.joint) - skeleton.names.begin());
  PoseEdits edits = edits_.shown();
  if (edits.turns.empty()) edits.turns.assign(skeleton.size(), glm::dvec3(0));
  glm::dvec3 angles = slider_angles(edits.turns[joint]);
  bool moved = false, let_go = false;
  for (int axis = 0; axis < 3; ++axis) {
    const std::array<const char*, 3> names{"x", "y", "z"};
    auto degrees = static_cast<float>(angles[axis]) * kDegrees;
    if (std::abs(degrees) < 0.5f) degrees = 0;  // not "-0"
    const float most = axis == 1 ? 90.0f : 180.0f;
    if (ImGui::SliderFloat(names[static_cast<size_t>(axis)], &degrees, -most, most, "%.0f deg")) angles[axis] = double(degrees / kDegrees), moved = true;
    note(names[static_cast<size_t>(axis)]);
    let_go |= ImGui::IsItemDeactivatedAfterEdit();
  }
  if (moved) {
    edits.turns[joint] = axis_angle_of_sliders(angles);
    edits_.show(edits);
  }
  if (let_go) edits_.keep();
  if (ImGui::Button("reset joint")) edits_.change(without_edit(edits_.shown(), static_cast<int>(joint)));
  ImGui::SameLine();
  if (ImGui::Button("reset all")) edits_.change({});
  ImGui::SameLine();
  if (ImGui::Button("to other side")) {
    const Pose base = scene_.base_pose(state);
    edits_.change(edits_between(base, copied_across(skeleton, scene_.pose(state), static_cast<int>(joint)), edits_.shown()));
  }
  const Motion& motion = scene_.motion();
  if (motion.frames.size() > 1) {
    if (ImGui::BeginCombo("blend with", state.blend_frame ? fmt::format("frame {}", *state.blend_frame).c_str() : "nothing")) {
      if (ImGui::Selectable("nothing", !state.blend_frame)) state.blend_frame.reset();
      for (const MotionFrame& frame : motion.frames)
        if (ImGui::Selectable(fmt::format("frame {}", frame.number).c_str(), state.blend_frame == frame.number)) state.blend_frame = frame.number;
      ImGui::EndCombo();
    }
    auto weight = static_cast<float>(state.blend_weight);
    if (state.blend_frame && ImGui::SliderFloat("weight", &weight, 0, 1, "%.2f")) state.blend_weight = std::clamp(double{weight}, 0.0, 1.0);
  }

  const ShapeSpace& shapes = scene_.avatar().body.shape;
  if (shapes.size() > 0) {
    ImGui::Separator();
    std::vector<double> beta = state.shape.empty() ? shapes.beta : state.shape;
    for (size_t b = 0; b < shapes.size(); ++b) {
      auto number = static_cast<float>(beta[b]);
      if (ImGui::SliderFloat(shapes.names[b].c_str(), &number, -5, 5, "%.2f")) {
        beta[b] = std::clamp(double{number}, -5.0, 5.0);
        state.shape = beta;
      }
    }
    if (ImGui::Button("own shape")) state.shape.clear();
  }
  const std::vector<int>& frames = scene_.avatar().latent_frames;
  if (scene_.avatar().spec.latent_size > 0 && !frames.empty()) {
    ImGui::Separator();
    if (ImGui::BeginCombo("code", state.latent_row ? fmt::format("frame {}", frames[static_cast<size_t>(*state.latent_row)]).c_str() : "of the frame")) {
      if (ImGui::Selectable("of the frame", !state.latent_row)) state.latent_row.reset();
      for (size_t row = 0; row < frames.size(); ++row)
        if (ImGui::Selectable(fmt::format("frame {}", frames[row]).c_str(), state.latent_row == static_cast<int>(row))) state.latent_row = static_cast<int>(row);
      ImGui::EndCombo();
    }
  }
}

void Panels::quality(ViewState& state, const PanelFacts& facts) {
  if (ImGui::BeginCombo("at rest", state.quality.c_str())) {
    for (const Quality& quality : qualities(scene_.avatar()))
      if (quality.pixel_step == 1 && ImGui::Selectable(quality.preset.c_str(), quality.preset == state.quality)) state.quality = quality.preset, state.knobs.clear();
    ImGui::EndCombo();
  }
  note("at rest");
  ImGui::Checkbox("error against exact", &state.compare_with_exact);
  note("error against exact");
  // Knobs as on the command line: KNOB=VALUE and enter.
  if (ImGui::InputTextWithHint("set", "knob=value", knob_, sizeof knob_, ImGuiInputTextFlags_EnterReturnsTrue)) {
    const std::string text(knob_);
    const size_t equals = text.find('=');
    try {
      if (equals == std::string::npos) throw InputError(text, "", "KNOB=VALUE, as for arah render --set", "no =");
      RenderSettings settings = render_preset(scene_.avatar(), state.quality);
      set_render_knob(settings, text.substr(0, equals), text.substr(equals + 1));
      state.knobs[text.substr(0, equals)] = text.substr(equals + 1);
      knob_error_.clear();
      knob_[0] = 0;
    } catch (const InputError& error) {
      knob_error_ = error.what();
    }
  }
  note("set");
  if (!knob_error_.empty()) ImGui::TextWrapped("%s", knob_error_.c_str());
  std::string dropped;
  for (const auto& [knob, value] : state.knobs) {
    ImGui::PushID(knob.c_str());
    if (ImGui::SmallButton("x")) dropped = knob;
    ImGui::PopID();
    ImGui::SameLine();
    ImGui::Text("%s=%s", knob.c_str(), value.c_str());
  }
  state.knobs.erase(dropped);
  if (ImGui::TreeNode("all knobs")) {
    std::string json = render_settings_json(render_settings_of(state, scene_.avatar()));
    for (char& letter : json)
      if (letter == ',') letter = '\n';
    ImGui::TextUnformatted(json.c_str());
    ImGui::TreePop();
  }
  ImGui::Text("window %.1f ms", facts.window_ms);
  if (!facts.drawn) return;
  ImGui::Text("%s: %.0f ms", to_string(facts.drawn->quality).c_str(), 1000 * facts.drawn->seconds);
  for (const auto& [stage, time] : facts.drawn->stages) ImGui::Text("  %-24s %8.2f ms", stage.empty() ? "other" : stage.c_str(), time);
  if (!facts.drawn->exact) return;
  if (std::isfinite(facts.drawn->exact->psnr)) ImGui::Text("%.1f dB against paper, which took %.1f s", facts.drawn->exact->psnr, facts.drawn->exact->seconds);
  else ImGui::Text("the same as paper, which took %.1f s", facts.drawn->exact->seconds);
}

void Panels::keep(const PanelFacts& facts, std::vector<Wish>& wishes) {
  if (ImGui::Button("screenshot")) wishes.push_back(Wish::screenshot);
  note("screenshot");
  ImGui::SameLine();
  if (ImGui::Button(facts.recording ? "end video" : "video")) wishes.push_back(Wish::record);
  note("video");
  ImGui::SameLine();
  if (ImGui::Button("mesh")) wishes.push_back(Wish::export_mesh);
  note("mesh");
  ImGui::SameLine();
  if (ImGui::Button("state")) wishes.push_back(Wish::save_state);
  note("state");
  if (!facts.job.running) return;
  ImGui::ProgressBar(static_cast<float>(facts.job.part), {-60, 0}, facts.job.name.c_str());
  ImGui::SameLine();
  if (ImGui::Button("stop")) wishes.push_back(Wish::stop_job);
}

void Panels::keys_window() {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5f * size.x, 0.5f * size.y}, ImGuiCond_Appearing, {0.5f, 0.5f});
  ImGui::Begin("Keys", &shows_keys_, ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoCollapse);
  for (const auto& [key, does] : kKeys) {
    ImGui::TextUnformatted(key);
    ImGui::SameLine(14 * ImGui::GetFontSize());
    ImGui::TextUnformatted(does);
  }
  ImGui::End();
}

}  // namespace arah
