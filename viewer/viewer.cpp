#include "viewer/viewer.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>
#include <imgui.h>
#include <imgui_impl_glfw.h>
#include <imgui_impl_vulkan.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <deque>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "host/avatar/avatar_file.h"
#include "host/body/pose.h"
#include "host/cli/progress.h"
#include "viewer/frame_times.h"
#include "viewer/picture_worker.h"
#include "viewer/presentation.h"
#include "viewer/screen_image.h"
#include "viewer/viewpoint.h"
#include "viewer/window.h"

namespace arah {
namespace {

using Clock = std::chrono::steady_clock;
double milliseconds(Clock::duration d) { return std::chrono::duration<double, std::milli>(d).count(); }

constexpr double kCpuFrame = 0.07, kGpuFrame = 0.012;  // seconds that a moving picture may take
constexpr float kPanelWidth = 300;                     // units of the window

// ImGui's context and its GLFW back end; its Vulkan back end is the Presentation's.
class Panels {
 public:
  explicit Panels(const Window& window) {
    IMGUI_CHECKVERSION();
    ImGui::CreateContext();
    ImGui::GetIO().IniFilename = nullptr;  // where panels are is the viewer's to keep
    ImGui::StyleColorsDark();
    const auto scale = static_cast<float>(window.scale());
    ImGui::GetStyle().ScaleAllSizes(scale);
    ImFontConfig font;
    font.SizePixels = std::round(13 * scale);
    ImGui::GetIO().Fonts->AddFontDefault(&font);
    ImGui_ImplGlfw_InitForVulkan(window.handle(), true);
  }
  ~Panels() {
    ImGui_ImplGlfw_Shutdown();
    ImGui::DestroyContext();
  }
  Panels(const Panels&) = delete;
  Panels& operator=(const Panels&) = delete;
};

class Viewer {
 public:
  Viewer(const ViewerOptions& options, Window& window, Device& device, std::shared_ptr<const Avatar> avatar)
      : options_(options), window_(window), device_(device), avatar_(std::move(avatar)), motion_(chosen_motion(options.motion, *avatar_)), panels_(window), presentation_(device, window) {
    pose_ = motion_.frames.front().pose;
    viewpoint_ = viewpoint_around(posed_vertices(avatar_->body, pose_), motion_.up);
    const bool cpu = device.report().type == DeviceType::cpu;
    worker_ = std::make_unique<PictureWorker>(device, avatar_, cpu ? kCpuFrame : kGpuFrame, [] { Window::wake(); });
  }

  int run() {
    tell({{"event", "open"}, {"device", device_.report().name}});
    while (!window_.closing()) {
      window_.wait(due_ > 0 ? 0 : 0.5);
      woke_ = Clock::now();
      frame();
    }
    if (options_.measure) {
      std::fputs(times_.table().c_str(), stdout);
      tell({{"event", "times"}, {"stages", nlohmann::json::parse(times_.json())}});
    }
    worker_.reset();
    const std::vector<std::string> messages = device_.validation_messages();
    for (const std::string& message : messages) std::fprintf(stderr, "arah-view: validation: %s\n", message.c_str());
    tell({{"event", "closed"}, {"frames", presentation_.frames()}, {"swapchains", presentation_.swapchains()}, {"validation_messages", messages.size()}});
    return messages.empty() ? 0 : 1;
  }

 private:
  void frame() {
    const auto start = Clock::now();
    take_picture();
    ImGui_ImplVulkan_NewFrame();
    ImGui_ImplGlfw_NewFrame();
    ImGui::NewFrame();
    hands();
    if (options_.measure) measure();
    panel();
    ImGui::Render();
    order();
    presentation_.present(place_, ImGui::GetDrawData());
    times_.add("frame of the window", milliseconds(Clock::now() - start));
    answered();
    if (due_ > 0) --due_;
  }

  // What the mouse does to the picture.
  void hands() {
    const FramebufferSize size = window_.framebuffer();
    const auto panel = static_cast<int>(std::lround(kPanelWidth * window_.scale()));
    place_ = {std::min(panel, size.width), 0, std::max(0, size.width - panel), size.height};
    const ImGuiIO& io = ImGui::GetIO();
    if (io.WantCaptureMouse || place_.height == 0) return;
    const glm::dvec2 moved{io.MouseDelta.x, io.MouseDelta.y};
    if (ImGui::IsMouseDragging(ImGuiMouseButton_Left, 0) && !io.KeyShift) viewpoint_ = orbited(viewpoint_, moved, place_.height);
    else if (ImGui::IsMouseDragging(ImGuiMouseButton_Left, 0) || ImGui::IsMouseDragging(ImGuiMouseButton_Right, 0) || ImGui::IsMouseDragging(ImGuiMouseButton_Middle, 0)) viewpoint_ = panned(viewpoint_, moved, place_.height);
    if (io.MouseWheel != 0) viewpoint_ = dollied(viewpoint_, double{io.MouseWheel});
  }

  // A hand that turns the person steadily, then lets go.
  void measure() {
    const double seconds = std::chrono::duration<double>(Clock::now() - first_picture_.value_or(Clock::now())).count();
    if (!first_picture_) return;
    due_ = std::max(due_, 1);
    if (seconds < *options_.measure) viewpoint_.yaw = std::remainder(2 * std::numbers::pi * seconds / 5, 2 * std::numbers::pi);
    else if (drawn_ && drawn_->finest && drawn_->order == newest_) {
      times_.add("rest to the finest picture", milliseconds(Clock::now() - last_order_));
      window_.close();
    }
  }

  void panel() {
    ImGui::SetNextWindowPos({0, 0});
    ImGui::SetNextWindowSize({kPanelWidth * static_cast<float>(window_.scale()), ImGui::GetIO().DisplaySize.y});
    ImGui::Begin("arah", nullptr, ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoTitleBar);
    ImGui::TextUnformatted(options_.avatar.filename().string().c_str());
    ImGui::TextUnformatted(worker_->doing().c_str());
    ImGui::End();
    if (!drawn_) return;
    const std::string mark = drawn_->part < 1 ? fmt::format("{} {:.0f} %", to_string(drawn_->quality), 100 * drawn_->part) : to_string(drawn_->quality);
    ImGui::GetForegroundDrawList()->AddText({static_cast<float>(place_.x) + 8, static_cast<float>(place_.height) - 22}, IM_COL32(230, 230, 230, 255), mark.c_str());
  }

  void order() {
    if (place_.width == 0 || place_.height == 0) return;
    PictureOrder wanted;
    wanted.camera = camera_at(viewpoint_, place_.width, place_.height);
    wanted.pose = pose_;
    wanted.latent_row = latent_row_of(motion_, *avatar_, motion_.frames.front().number);
    wanted.finest = options_.finest;
    if (ordered_ && same(*ordered_, wanted)) return;
    newest_ = worker_->order(wanted);
    ordered_ = std::move(wanted);
    last_order_ = woke_;
    asked_.emplace_back(newest_, woke_);
  }

  static bool same(const PictureOrder& a, const PictureOrder& b) {
    return a.camera.R == b.camera.R && a.camera.T == b.camera.T && a.camera.K == b.camera.K && a.camera.width == b.camera.width && a.camera.height == b.camera.height && a.pose == b.pose && a.latent_row == b.latent_row &&
           a.shape == b.shape && a.normals == b.normals && a.finest == b.finest && a.knobs == b.knobs && a.compare_with_exact == b.compare_with_exact;
  }

  void take_picture() {
    std::optional<DrawnPicture> fresh = worker_->take();
    if (!fresh) return;
    due_ = std::max(due_, 2);
    if (fresh->part == 1) {
      times_.add("picture " + to_string(fresh->quality), 1000 * fresh->seconds);
      for (const auto& [stage, time] : fresh->stages) times_.add(to_string(fresh->quality) + ": " + (stage.empty() ? "other" : stage), time);
    }
    if (!first_picture_) first_picture_ = Clock::now();
    drawn_ = std::move(fresh);
    presentation_.set_picture(color_on_screen(*drawn_->picture));
    tell({{"event", "picture"}, {"order", drawn_->order}, {"quality", to_string(drawn_->quality)}, {"part", drawn_->part}, {"finest", drawn_->finest}, {"seconds", drawn_->seconds}});
  }

  // Orders that the picture on the screen answers.
  void answered() {
    while (drawn_ && !asked_.empty() && asked_.front().first <= drawn_->order) {
      times_.add("input to picture on the screen", milliseconds(Clock::now() - asked_.front().second));
      asked_.pop_front();
    }
  }

  void tell(const nlohmann::ordered_json& event) const {
    if (options_.events) write_text(stdout, event.dump() + "\n");
  }

  const ViewerOptions& options_;
  Window& window_;
  Device& device_;
  std::shared_ptr<const Avatar> avatar_;
  ChosenMotion motion_;
  Panels panels_;
  Presentation presentation_;
  std::unique_ptr<PictureWorker> worker_;
  Viewpoint viewpoint_;
  Pose pose_;
  PicturePlace place_;
  std::optional<PictureOrder> ordered_;
  uint64_t newest_ = 0;
  std::optional<DrawnPicture> drawn_;
  std::deque<std::pair<uint64_t, Clock::time_point>> asked_;  // orders that no picture answered yet
  FrameTimes times_;
  Clock::time_point woke_, last_order_;
  std::optional<Clock::time_point> first_picture_;
  int due_ = 3;  // frames that the window still needs though nothing happens
};

}  // namespace

int view(const ViewerOptions& options) {
  const auto avatar = std::make_shared<const Avatar>(load_avatar(avatar_file(options.avatar)));
  Window window("arah " + options.avatar.filename().string(), options.width, options.height);
  DeviceOptions device_options = options.device;
  device_options.window_extensions = window.vulkan_extensions();
  device_options.profile = true;
  Device device(device_options);
  return Viewer(options, window, device, avatar).run();
}

}  // namespace arah
