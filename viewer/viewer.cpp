#include "viewer/viewer.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>
#include <imgui.h>
#include <imgui_impl_glfw.h>
#include <imgui_impl_vulkan.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "host/avatar/avatar_file.h"
#include "host/body/pose.h"
#include "host/cli/interrupt.h"
#include "host/cli/progress.h"
#include "host/evaluation/layers.h"
#include "host/file_writing.h"
#include "host/input_error.h"
#include "viewer/followed_run.h"
#include "viewer/frame_times.h"
#include "viewer/overlay.h"
#include "viewer/panels.h"
#include "viewer/presentation.h"
#include "viewer/saving.h"
#include "viewer/window.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr double kCpuFrame = 0.07, kGpuFrame = 0.012;   // seconds that a moving picture may take
constexpr double kCpuTick = 1.0 / 20, kGpuTick = 1.0 / 60;  // between frames of the window while something plays
constexpr double kCpuLeast = 0.02;                      // between any two of them
constexpr double kVideoRate = 25;                       // frames a second of a video of what is played
constexpr const char* kStages = "stages";                // what --measure does at last
constexpr float kPanelWidth = 300;                      // units of the window
constexpr std::array<int, 3> kBackground{28, 28, 31};

double seconds_between(Clock::time_point from, Clock::time_point to) { return std::chrono::duration<double>(to - from).count(); }

// ImGui's context and its GLFW back end; its Vulkan back end is the Presentation's.
class PanelContext {
 public:
  explicit PanelContext(const Window& window) {
    IMGUI_CHECKVERSION();
    ImGui::CreateContext();
    ImGui::GetIO().IniFilename = nullptr;  // panels stay where they are
    ImGui::StyleColorsDark();
    const auto scale = static_cast<float>(window.scale());
    ImGui::GetStyle().ScaleAllSizes(scale);
    ImFontConfig font;
    font.SizePixels = std::round(13 * scale);
    ImGui::GetIO().Fonts->AddFontDefault(&font);
    ImGui_ImplGlfw_InitForVulkan(window.handle(), true);
  }
  ~PanelContext() {
    ImGui_ImplGlfw_Shutdown();
    ImGui::DestroyContext();
  }
  PanelContext(const PanelContext&) = delete;
  PanelContext& operator=(const PanelContext&) = delete;
};

// Remembers that a user has seen the hint: an empty file among the user's own states.
fs::path hint_file() {
  if (const char* states = std::getenv("XDG_STATE_HOME"); states && *states) return fs::path(states) / "arah" / "hint-seen";
  if (const char* home = std::getenv("HOME"); home && *home) return fs::path(home) / ".local" / "state" / "arah" / "hint-seen";
  return {};
}

ScreenPicture over_background(int width, int height, const std::vector<uint8_t>& rgba) {
  ScreenPicture screen{width, height, rgba};
  for (size_t i = 0; i < rgba.size(); i += 4) {
    const int alpha = rgba[i + 3];
    for (size_t c = 0; c < 3; ++c) screen.rgba[i + c] = static_cast<uint8_t>((rgba[i + c] * alpha + kBackground[c] * (255 - alpha) + 127) / 255);
    screen.rgba[i + 3] = 255;
  }
  return screen;
}

class Viewer {
 public:
  Viewer(const ViewerOptions& options, Window& window, Device& device, std::shared_ptr<const Avatar> avatar, ViewState state)
      : options_(options), window_(window), device_(device), scene_(std::move(avatar), options.motion), state_(scene_.fitting(std::move(state))), panels_(scene_, edits_), overlay_(scene_.avatar().body), followed_(options.avatar),
        context_(window), presentation_(device, window), cpu_(device.report().type == DeviceType::cpu) {
    edits_.change(edits_of(state_, scene_.motion().skeleton, "the view"));
    shows_hint_ = !state_.hint_seen && !options.measure && !hint_file().empty() && !fs::exists(hint_file());
    worker_ = std::make_unique<PictureWorker>(device, scene_.shared_avatar(), cpu_ ? kCpuFrame : kGpuFrame, [] { Window::wake(); });
  }

  int run() {
    tell({{"event", "open"}, {"device", device_.report().name}, {"joints", scene_.motion().skeleton.size()}, {"frames", scene_.motion().frames.size()}});
    const Interrupt interrupt;
    while (!window_.closing() && !interrupt.wanted()) {
      window_.wait(due_ > 0 ? 0 : moves() ? (cpu_ ? kCpuTick : kGpuTick) : 0.25);
      // A mouse tells of itself more often than anyone sees, and on a CPU device each frame of the window takes of the picture's time.
      while (cpu_ && seconds_between(last_frame_, Clock::now()) < kCpuLeast) window_.wait(kCpuLeast - seconds_between(last_frame_, Clock::now()));
      frame();
    }
    if (options_.measure) {
      std::fputs(times_.table().c_str(), stdout);
      tell({{"event", "times"}, {"stages", nlohmann::json::parse(times_.json())}});
    }
    worker_.reset();
    const std::vector<std::string> messages = device_.validation_messages();
    for (const std::string& message : messages) write_text(stderr, "arah-view: validation: " + message + "\n");
    tell({{"event", "closed"}, {"frames", presentation_.frames()}, {"swapchains", presentation_.swapchains()}, {"validation_messages", messages.size()}});
    return messages.empty() ? 0 : 1;
  }

 private:
  bool moves() const { return state_.timeline.playing || (state_.turntable != 0 && state_.camera.empty()) || state_.comparison.mode == ComparisonMode::blink || recording_; }

  void frame() {
    const Clock::time_point start = Clock::now();
    const double passed = std::min(0.25, seconds_between(last_frame_, start));
    last_frame_ = start;
    if (std::shared_ptr<const Avatar> newer = followed_.newest()) take_avatar(std::move(newer));
    take_picture();
    ImGui_ImplVulkan_NewFrame();
    ImGui_ImplGlfw_NewFrame();
    ImGui::NewFrame();
    time_ += passed;
    state_.timeline = advanced(state_.timeline, scene_.motion(), passed);
    if (state_.turntable != 0 && state_.camera.empty()) state_.viewpoint.yaw = std::remainder(state_.viewpoint.yaw + state_.turntable * passed, 2 * std::numbers::pi);
    const ViewState before = state_;
    place_picture();
    for (const KeyPress& press : window_.take_keys()) {
      dismiss_hint();
      for (const Wish wish : panels_.key(state_, press)) grant(wish);
    }
    hands();
    if (options_.measure) measure();
    panels();
    set_edits(state_, scene_.motion().skeleton, edits_.shown());
    if (state_ != before) due_ = std::max(due_, 2);
    place_picture();
    draw_over_picture();
    record(passed);
    order(start);
    compose();
    ImGui::Render();
    const bool shown = presentation_.present(place_, ImGui::GetDrawData());
    if (!shown) return;
    const double took = 1000 * seconds_between(start, Clock::now());
    window_ms_ += 0.1 * (took - window_ms_);
    times_.add("frame of the window", took);
    answered();
    if (due_ > 0) --due_;
  }

  // Where the picture goes: right of the panels, as large as its shape lets it.
  void place_picture() {
    const FramebufferSize size = window_.framebuffer();
    const int panel = std::min(static_cast<int>(std::lround(kPanelWidth * window_.scale())), size.width * 2 / 3);
    room_ = {panel, 0, std::max(0, size.width - panel), size.height};
    place_ = room_;
    if (room_.width < 1 || room_.height < 1) return;
    camera_ = scene_.camera(state_, room_.width, room_.height);
    const double fit = std::min(double(room_.width) / camera_.width, double(room_.height) / camera_.height);
    place_.width = std::max(1, static_cast<int>(fit * camera_.width));
    place_.height = std::max(1, static_cast<int>(fit * camera_.height));
    place_.x += (room_.width - place_.width) / 2;
    place_.y += (room_.height - place_.height) / 2;
  }

  // Between the window's units, as ImGui has them, and pixels of the camera's picture.
  double unit() const { return std::max(1e-3, double{ImGui::GetIO().DisplayFramebufferScale.x}); }
  double enlarged() const { return double(place_.width) / camera_.width; }
  glm::dvec2 in_picture(ImVec2 at) const { return {(at.x * unit() - place_.x) / enlarged() - 0.5, (at.y * unit() - place_.y) / enlarged() - 0.5}; }
  ImVec2 in_window(glm::dvec2 pixel) const { return {static_cast<float>((place_.x + (pixel.x + 0.5) * enlarged()) / unit()), static_cast<float>((place_.y + (pixel.y + 0.5) * enlarged()) / unit())}; }

  // What the mouse does to the picture.
  void hands() {
    const ImGuiIO& io = ImGui::GetIO();
    if (room_.width < 1 || room_.height < 1) return;
    if (!io.WantCaptureMouse && ImGui::IsMouseClicked(ImGuiMouseButton_Left)) dismiss_hint();
    const glm::dvec2 cursor = in_picture(io.MousePos);
    if (held_) {
      const Pose base = scene_.base_pose(state_);
      edits_.show(edits_between(base, pulled(camera_, scene_.skeleton(state_), scene_.pose(state_), *held_, cursor), edits_.shown()));
      if (!io.MouseDown[0]) {
        held_.reset();
        edits_.keep();
      }
      return;
    }
    if (io.WantCaptureMouse) return;
    if (state_.handles && ImGui::IsMouseClicked(ImGuiMouseButton_Left)) {
      const std::vector<glm::dvec3> joints = posed_joints(scene_.skeleton(state_), scene_.pose(state_));
      if (const std::optional<int> joint = joint_under(camera_, joints, cursor, 12 * unit() / enlarged())) {
        state_.joint = scene_.motion().skeleton.names[static_cast<size_t>(*joint)];
        held_ = taken(camera_, joints, *joint, cursor);
        return;
      }
    }
    const glm::dvec2 moved = unit() * glm::dvec2{io.MouseDelta.x, io.MouseDelta.y};
    const bool left = ImGui::IsMouseDragging(ImGuiMouseButton_Left, 0), others = ImGui::IsMouseDragging(ImGuiMouseButton_Right, 0) || ImGui::IsMouseDragging(ImGuiMouseButton_Middle, 0);
    if ((!left && !others && io.MouseWheel == 0) || (moved == glm::dvec2(0) && io.MouseWheel == 0)) return;
    if (!state_.camera.empty()) {  // from where the camera stands
      state_.viewpoint = viewpoint_of(camera_, scene_.front(scene_.pose(state_)).target, state_.viewpoint.up);
      state_.camera.clear();
    }
    if (left && !io.KeyShift) state_.viewpoint = orbited(state_.viewpoint, moved, room_.height);
    else if (left || others) state_.viewpoint = panned(state_.viewpoint, moved, room_.height);
    if (io.MouseWheel != 0) state_.viewpoint = dollied(state_.viewpoint, double{io.MouseWheel});
  }

  void grant(Wish wish) {
    switch (wish) {
      case Wish::screenshot: return save_screenshot();
      case Wish::record:
        if (recording_) return end_recording();
        return begin_recording();
      case Wish::save_state: return save_state();
      case Wish::export_mesh: {
        const PictureOrder order = scene_.order(state_, room_.width, room_.height);
        return worker_->start(mesh_job(free_name(options_.out, "mesh", ".ply"), order.pose, order.latent_row));
      }
      case Wish::stop_job: return worker_->stop_job();
      case Wish::front:
        state_.camera.clear();
        state_.viewpoint = scene_.front(scene_.pose(state_));
        return;
      case Wish::quit: return window_.close();
    }
  }

  void save_screenshot() {
    if (!drawn_) return;
    say_failure([&] {
      const fs::path path = free_name(options_.out, "screenshot", ".png");
      write_file_safely(path, screenshot(*drawn_, layer_named(state_.layer)));
      message_ = fmt::format("{} ({})", path.string(), drawn_->part < 1 ? "not whole yet" : to_string(drawn_->quality));
      tell({{"event", "screenshot"}, {"file", path.string()}, {"quality", to_string(drawn_->quality)}, {"part", drawn_->part}});
    });
  }

  void save_state() {
    say_failure([&] {
      ViewState saved = state_;
      const fs::path path = options_.state.empty() ? options_.out / "view.json" : options_.state;
      saved.hint_seen = true;
      saved.timeline.playing = false;
      const double scale = window_.scale();
      const FramebufferSize size = window_.framebuffer();
      saved.window_width = std::clamp(static_cast<int>(std::lround(size.width / scale)), 64, 16384);
      saved.window_height = std::clamp(static_cast<int>(std::lround(size.height / scale)), 64, 16384);
      write_view_state(path, saved);
      message_ = path.string() + ": opened again with --state";
      tell({{"event", "state"}, {"file", path.string()}});
    });
  }

  void begin_recording() {
    if (worker_->job().running) return;
    recording_ = true;
    recorded_.clear();
    record_time_ = 0;
  }

  void record(double passed) {
    if (!recording_ || room_.width < 1 || room_.height < 1) return;
    const PictureOrder order = scene_.order(state_, room_.width, room_.height);
    // All pictures of a video are of one size.
    if (!recorded_.empty() && (recorded_.front().camera.width != order.camera.width || recorded_.front().camera.height != order.camera.height)) return end_recording();
    for (record_time_ += passed; record_time_ >= double(recorded_.size()) / kVideoRate;) recorded_.push_back({order.pose, order.camera, order.latent_row});
  }

  void end_recording() {
    recording_ = false;
    if (recorded_.empty()) return;
    say_failure([&] {
      worker_->start(video_job(free_name(options_.out, "video", ".mp4"), recorded_, render_settings_of(state_, scene_.avatar()), kVideoRate));
    });
  }

  // What is refused becomes a message; the window stays.
  void say_failure(const std::function<void()>& work) {
    try {
      work();
    } catch (const std::exception& error) {
      message_ = error.what();
      tell({{"event", "error"}, {"text", message_}});
    }
  }

  // Two fifths of the time a hand that turns the person steadily, two fifths, where there is a motion, it plays; one fifth turns with times by stage, whose
  // taking costs time itself; then rest.
  void measure() {
    if (!first_picture_) return;
    due_ = std::max(due_, 1);
    const double seconds = seconds_between(*first_picture_, Clock::now()), part = seconds / *options_.measure;
    const bool plays = scene_.motion().frames.size() > 1 && scene_.posable();
    const std::string now = part >= 1 ? "rest" : part >= 0.8 ? kStages : plays && part >= 0.4 ? "playing" : "turning";
    if (now != measured_) asked_.clear();  // what is under way belongs to neither
    measured_ = now;
    if (measured_ == "playing" && !state_.timeline.playing) state_.timeline = played(state_.timeline, scene_.motion());
    if (measured_ != "playing") state_.timeline.playing = false;
    if (measured_ == "turning" || measured_ == kStages) state_.viewpoint.yaw = std::remainder(2 * std::numbers::pi * seconds / 5, 2 * std::numbers::pi);
    if (measured_ == "rest" && drawn_ && drawn_->finest && drawn_->order == newest_) {
      times_.add("rest to the finest picture", 1000 * seconds_between(last_order_, Clock::now()));
      window_.close();
    }
  }

  void panels() {
    const JobState job = worker_->job();
    if (job.outcome != job_outcome_ && !job.running) {
      job_outcome_ = job.outcome;
      if (!job.outcome.empty()) {
        message_ = job.outcome;
        tell({{"event", "job"}, {"name", job.name}, {"outcome", job.outcome}});
      }
    } else if (job.running) {
      job_outcome_.clear();
      due_ = std::max(due_, 1);
    }
    PanelFacts facts;
    facts.title = fmt::format("{}  {} steps", options_.avatar.filename().string(), scene_.avatar().steps);
    if (drawn_) facts.drawn = &*drawn_;
    facts.doing = worker_->doing();
    facts.job = job;
    facts.recording = recording_;
    facts.message = scene_.words().empty() ? message_ : scene_.words();
    facts.legend = legend_;
    facts.psnr = psnr_;
    facts.window_ms = window_ms_;
    const float scale = static_cast<float>(1 / unit());
    for (const Wish wish : panels_.draw(state_, facts, static_cast<float>(room_.x) * scale, ImGui::GetIO().DisplaySize.y)) grant(wish);
    if (options_.events && panels_.places() != told_places_) {
      told_places_ = panels_.places();
      nlohmann::ordered_json places;
      for (const auto& [name, at] : told_places_) places[name] = {at.first, at.second};
      tell({{"event", "layout"}, {"widgets", places}, {"picture", {place_.x, place_.y, place_.width, place_.height}}});
    }
  }

  void draw_over_picture() {
    if (place_.width < 1 || place_.height < 1) return;
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    const auto color = [](const OverlayColor& c) { return IM_COL32(c.r, c.g, c.b, c.a); };
    if (state_.skeleton || state_.mesh || state_.handles) {
      // Over a picture that is behind, where it is; a hand that drags sees where it is.
      const auto answered = drawn_ && !held_ ? orders_.find(drawn_->order) : orders_.end();
      const bool behind = answered != orders_.end() && answered->second.camera.width == camera_.width && answered->second.camera.height == camera_.height;
      const Pose pose = behind ? answered->second.pose : scene_.pose(state_);
      const Camera camera = behind ? answered->second.camera : camera_;
      if (state_.mesh)
        for (const OverlayLine& line : overlay_.lines(camera, scene_.vertices(state_, pose))) list.AddLine(in_window(line.from), in_window(line.to), color(line.color));
      const SkeletonOverlay skeleton = skeleton_overlay(camera, scene_.motion().skeleton, posed_joints(scene_.skeleton(state_), pose));
      if (state_.skeleton || state_.handles)
        for (const OverlayLine& line : skeleton.bones) list.AddLine(in_window(line.from), in_window(line.to), color(line.color), 2);
      for (const OverlayJoint& joint : skeleton.joints) {
        const bool chosen = scene_.motion().skeleton.names[static_cast<size_t>(joint.joint)] == state_.joint;
        if (state_.handles) list.AddCircle(in_window(joint.place), chosen ? 8.0f : 6.0f, color(joint.color), 0, chosen ? 3.0f : 1.5f);
        else if (state_.skeleton) list.AddCircleFilled(in_window(joint.place), 3, color(joint.color));
      }
      if (state_.handles && options_.events) tell_joints(skeleton);
    }
    if (state_.comparison.mode == ComparisonMode::split && !state_.camera.empty() && state_.layer == to_string(PictureLayer::color)) {
      const double x = state_.comparison.position * camera_.width - 0.5;
      list.AddLine(in_window({x, -0.5}), in_window({x, camera_.height - 0.5}), IM_COL32(255, 255, 255, 160));
    }
    const auto corner = [&](float y, const std::string& text, ImU32 ink) {
      const ImVec2 at{static_cast<float>(room_.x / unit()) + 8, y};
      list.AddText({at.x + 1, at.y + 1}, IM_COL32(0, 0, 0, 200), text.c_str());
      list.AddText(at, ink, text.c_str());
    };
    const float bottom = ImGui::GetIO().DisplaySize.y - 1.6f * ImGui::GetFontSize();
    if (drawn_) corner(bottom, drawn_->part < 1 ? fmt::format("{}  {:.0f} %", to_string(drawn_->quality), 100 * drawn_->part) : to_string(drawn_->quality), IM_COL32(235, 235, 235, 255));
    else corner(bottom, "getting ready: " + worker_->doing(), IM_COL32(235, 235, 235, 255));
    if (recording_) corner(8, fmt::format("video: {:.1f} s", record_time_), IM_COL32(255, 90, 90, 255));
    if (!shows_hint_) return;
    float y = 10;
    for (const char* line : {"Drag to turn, right drag to move, wheel to come nearer.", "Space plays the motion; J, then drag a joint, poses.", "? lists all keys.  (click to begin)"}) {
      corner(y, line, IM_COL32(255, 225, 120, 255));
      y += 1.4f * ImGui::GetFontSize();
    }
  }

  void tell_joints(const SkeletonOverlay& skeleton) {
    nlohmann::ordered_json joints;
    for (const OverlayJoint& joint : skeleton.joints) {
      const ImVec2 at = in_window(joint.place);
      joints[scene_.motion().skeleton.names[static_cast<size_t>(joint.joint)]] = {at.x, at.y};
    }
    if (joints == told_joints_) return;
    told_joints_ = joints;
    tell({{"event", "joints"}, {"at", joints}});
  }

  void dismiss_hint() {
    if (!shows_hint_) return;
    shows_hint_ = false;
    state_.hint_seen = true;
    std::error_code error;  // where it cannot be kept, the hint comes again
    fs::create_directories(hint_file().parent_path(), error);
    if (!error) std::ofstream(hint_file()).flush();
  }

  void order(Clock::time_point woke) {
    if (room_.width < 1 || room_.height < 1) return;
    PictureOrder wanted = scene_.order(state_, room_.width, room_.height);
    wanted.profile = panels_.shows_stages() || measured_ == kStages;
    if (ordered_ && *ordered_ == wanted) return;
    newest_ = worker_->order(wanted);
    if (drawn_) orders_.erase(orders_.begin(), orders_.lower_bound(drawn_->order));
    orders_[newest_] = wanted;
    ordered_ = std::move(wanted);
    last_order_ = woke;
    asked_.emplace_back(newest_, woke);
  }

  void take_picture() {
    std::optional<DrawnPicture> fresh;
    try {
      fresh = worker_->take();
    } catch (const InputError& error) {  // knobs that do not go together, or a layer that this avatar does not have
      message_ = error.what();
      state_.knobs.clear();
      if (needs_renderer(layer_named(state_.layer))) state_.layer = to_string(PictureLayer::color);
      tell({{"event", "error"}, {"text", message_}});
    }
    if (!fresh) return;
    due_ = std::max(due_, 2);
    if (fresh->part == 1) {
      times_.add(fmt::format("picture {}{}", to_string(fresh->quality), fresh->stages.empty() ? "" : ", by stage"), 1000 * fresh->seconds);
      for (const auto& [stage, time] : fresh->stages) times_.add(fmt::format("  {}: {}", to_string(fresh->quality), stage.empty() ? "other" : stage), time);
    }
    if (!first_picture_) {
      first_picture_ = Clock::now();
      times_.add("start to the first picture", 1000 * seconds_between(start_, *first_picture_));
    }
    drawn_ = std::move(fresh);
    composed_.reset();
    tell({{"event", "picture"}, {"order", drawn_->order}, {"quality", to_string(drawn_->quality)}, {"part", drawn_->part}, {"finest", drawn_->finest && drawn_->order == newest_}, {"seconds", drawn_->seconds}, {"steps", drawn_->avatar->steps}});
  }

  void take_avatar(std::shared_ptr<const Avatar> newer) {
    say_failure([&] {
      scene_.set_avatar(newer);
      worker_->set_avatar(newer);
      state_ = scene_.fitting(state_);
      tell({{"event", "checkpoint"}, {"steps", newer->steps}});
    });
  }

  // The picture with what is laid over it by the pixel, where that has changed.
  void compose() {
    if (!drawn_) return;
    const Picture& picture = *drawn_->picture;
    const PictureLayer layer = layer_named(state_.layer);
    // One that was drawn for another layer: the right one is on its way.
    if ((needs_normals(layer) && picture.normal.empty()) || (needs_inspection(layer) && !picture.inspection) || needs_renderer(layer) != (drawn_->layer != nullptr)) return;
    const bool photograph_shown = state_.comparison.mode == ComparisonMode::blink && blink_shows_photograph(state_.comparison, time_);
    Composed wanted{state_.layer, state_.camera, scene_.frame_number(state_), state_.comparison, photograph_shown};
    if (composed_ == wanted) return;
    composed_ = std::move(wanted);
    legend_.clear();
    psnr_.reset();
    if (layer != PictureLayer::color) {
      const LayerImage image = drawn_->layer ? *drawn_->layer : layer_image(layer, picture, *drawn_->avatar);
      legend_ = describe(image.legend);
      return presentation_.set_picture(over_background(image.width, image.height, image.rgba));
    }
    const Image* photograph = state_.camera.empty() ? nullptr : scene_.photograph(state_, picture.width);
    if (photograph && (photograph->width != picture.width || photograph->height != picture.height)) photograph = nullptr;  // of a camera's picture to come
    const Rgba8 image = compared(picture, photograph, state_.comparison, time_);
    if (photograph && drawn_->finest && picture.width == camera_.width) psnr_ = compared_psnr(picture, *photograph, projected_box_mask(camera_, scene_.vertices(state_, scene_.pose(state_))));
    presentation_.set_picture(over_background(image.width, image.height, image.bytes));
  }

  // Orders that the picture on the screen answers.
  void answered() {
    while (drawn_ && !asked_.empty() && asked_.front().first <= drawn_->order) {
      if (!measured_.empty() && measured_ != kStages) times_.add(fmt::format("input to picture on the screen, {}", measured_), 1000 * seconds_between(asked_.front().second, Clock::now()));
      asked_.pop_front();
    }
  }

  void tell(const nlohmann::ordered_json& event) const {
    if (!options_.events) return;
    write_text(stdout, event.dump() + "\n");
    std::fflush(stdout);  // whoever listens waits for it
  }

  const ViewerOptions& options_;
  Window& window_;
  Device& device_;
  Scene scene_;
  ViewState state_;
  EditHistory edits_;
  Panels panels_;
  TemplateOverlay overlay_;
  FollowedRun followed_;
  PanelContext context_;
  Presentation presentation_;
  std::unique_ptr<PictureWorker> worker_;
  bool cpu_;

  PicturePlace room_, place_;  // beside the panels; of the picture in it
  Camera camera_;              // of the whole picture
  std::optional<HeldJoint> held_;

  std::optional<PictureOrder> ordered_;
  std::map<uint64_t, PictureOrder> orders_;  // by number, from the one that is on the screen on
  uint64_t newest_ = 0;
  std::optional<DrawnPicture> drawn_;
  struct Composed {
    std::string layer, camera;
    int frame = 0;
    Comparison comparison;
    bool photograph = false;
    bool operator==(const Composed&) const = default;
  };
  std::optional<Composed> composed_;
  std::string legend_, message_, job_outcome_;
  std::optional<double> psnr_;

  bool recording_ = false;
  double record_time_ = 0;
  std::vector<AnimationFrame> recorded_;

  std::deque<std::pair<uint64_t, Clock::time_point>> asked_;  // orders that no picture answered yet
  FrameTimes times_;
  double window_ms_ = 0, time_ = 0;
  std::string measured_;  // what --measure does now
  Clock::time_point start_ = Clock::now(), last_frame_ = start_, last_order_ = start_;
  std::optional<Clock::time_point> first_picture_;
  std::map<std::string, std::pair<float, float>> told_places_;
  nlohmann::ordered_json told_joints_;
  bool shows_hint_ = false;
  int due_ = 3;  // frames that the window still needs though nothing happens
};

}  // namespace

int view(const ViewerOptions& given) {
  ViewerOptions options = given;
  const auto avatar = std::make_shared<const Avatar>(load_avatar(FollowedRun::first_file(options.avatar)));
  std::optional<ViewState> saved;
  if (!options.state.empty() && fs::exists(options.state)) saved = read_view_state(options.state);
  if (saved && !saved->split.empty() && !options.split_given) options.motion.split = saved->split;
  ViewState state = saved ? *saved : Scene(avatar, options.motion).initial_state();
  if (options.quality) state.quality = *options.quality, state.knobs.clear();
  if (options.width) state.window_width = *options.width;
  if (options.height) state.window_height = *options.height;
  Window window("arah " + options.avatar.filename().string(), state.window_width, state.window_height);
  DeviceOptions device_options = options.device;
  device_options.window_extensions = window.vulkan_extensions();
  Device device(device_options);
  return Viewer(options, window, device, avatar, state).run();
}

}  // namespace arah
