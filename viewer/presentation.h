// What the window shows, drawn by Vulkan: a picture in its place and Dear ImGui's panels above it.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "kernels/vulkan/device.h"
#include "viewer/window.h"

struct ImDrawData;

namespace arah {

// Row-major, top left first; sRGB.
struct ScreenPicture {
  int width = 0;
  int height = 0;
  std::vector<uint8_t> rgba;  // [pixels][4]; alpha is not looked at
};

// Where a picture goes, pixels of the framebuffer.
struct PicturePlace {
  int x = 0, y = 0, width = 0, height = 0;
};

// A swapchain and what is drawn into it. Calls belong to the thread of main(); kernels may run on the same device from another
// one at the same time.
class Presentation {
 public:
  // Makes ImGui's Vulkan back end too: its context and GLFW back end must be there. Throws std::runtime_error where the
  // device cannot present to the window, or another call of Vulkan fails.
  Presentation(Device& device, const Window& window);
  ~Presentation();
  Presentation(const Presentation&) = delete;
  Presentation& operator=(const Presentation&) = delete;

  // The picture from now on; one that is not as large as its place is interpolated. An empty one shows the background alone.
  void set_picture(ScreenPicture picture);

  // Draws one frame: false where there is nothing to draw on (a minimised window). A swapchain that was lost or has another
  // size is made anew.
  bool present(const PicturePlace& place, ImDrawData* panels);

  uint64_t frames() const { return frames_; }                    // presented so far
  uint64_t swapchains() const { return swapchains_; }            // made so far

 private:
  struct State;
  void make_panels();
  void make_swapchain();
  void drop_swapchain();
  void make_picture_image();
  std::unique_ptr<State> state_;
  const Window& window_;
  ScreenPicture picture_;
  uint64_t picture_number_ = 0;  // counts set_picture()
  uint64_t frames_ = 0, swapchains_ = 0;
};

}  // namespace arah
