// The window of the system: GLFW's, as one object.
#pragma once

#include <string>
#include <vector>

struct GLFWwindow;

namespace arah {

struct FramebufferSize {
  int width = 0;  // pixels; 0 while the window is minimised
  int height = 0;
  bool operator==(const FramebufferSize&) const = default;
};

// A key that went down, or repeats while it is held.
struct KeyPress {
  int key = 0;  // GLFW_KEY_…
  bool shift = false, control = false, repeated = false;
};

// One at a time, on the thread of main().
class Window {
 public:
  // width, height: in the system's units, before its scaling. Throws std::runtime_error where there is no display, or
  // none that Vulkan can draw to: it says what to do.
  Window(const std::string& title, int width, int height);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  GLFWwindow* handle() const { return handle_; }
  // What Vulkan's instance must offer for it (DeviceOptions::window_extensions).
  const std::vector<std::string>& vulkan_extensions() const { return extensions_; }
  FramebufferSize framebuffer() const;
  double scale() const;  // pixels a unit of text and panels: 2 on a screen of twice the usual density
  bool closing() const;
  void close();

  // Those since the last call, in their order: none is lost that came and went between two frames.
  std::vector<KeyPress> take_keys();

  // Waits for events, at most so long, and handles them.
  void wait(double seconds) const;
  // Ends a wait from another thread.
  static void wake();

 private:
  GLFWwindow* handle_ = nullptr;
  std::vector<std::string> extensions_;
  std::vector<KeyPress> keys_;
};

}  // namespace arah
