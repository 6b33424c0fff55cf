#include "viewer/window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <utility>

namespace arah {
namespace {

std::runtime_error no_window(const std::string& what) {
  const char* reason = nullptr;
  glfwGetError(&reason);
  return std::runtime_error(fmt::format("no window: {}{}{}. arah render and arah animate need no display; without a screen: xvfb-run -s '-screen 0 1280x800x24' arah-view ...", what, reason ? ": " : "", reason ? reason : ""));
}

}  // namespace

Window::Window(const std::string& title, int width, int height) {
  if (!glfwInit()) throw no_window("there is no display");
  if (!glfwVulkanSupported()) {
    const std::runtime_error error = no_window("GLFW finds no Vulkan loader that can draw here");
    glfwTerminate();
    throw error;
  }
  uint32_t count = 0;
  const char** names = glfwGetRequiredInstanceExtensions(&count);
  if (!names) {
    const std::runtime_error error = no_window("no Vulkan driver draws to this display");
    glfwTerminate();
    throw error;
  }
  extensions_.assign(names, names + count);
  glfwWindowHint(GLFW_CLIENT_API, GLFW_NO_API);
  glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
  handle_ = glfwCreateWindow(width, height, title.c_str(), nullptr, nullptr);
  if (!handle_) {
    const std::runtime_error error = no_window(fmt::format("{} x {} could not be opened", width, height));
    glfwTerminate();
    throw error;
  }
  glfwSetWindowUserPointer(handle_, this);
  // ImGui's back end, made later, calls this one too.
  glfwSetKeyCallback(handle_, [](GLFWwindow* window, int key, int, int action, int modifiers) {
    if (action != GLFW_RELEASE) static_cast<Window*>(glfwGetWindowUserPointer(window))->keys_.push_back({key, (modifiers & GLFW_MOD_SHIFT) != 0, (modifiers & GLFW_MOD_CONTROL) != 0, action == GLFW_REPEAT});
  });
}

std::vector<KeyPress> Window::take_keys() { return std::exchange(keys_, {}); }

Window::~Window() {
  glfwDestroyWindow(handle_);
  glfwTerminate();
}

FramebufferSize Window::framebuffer() const {
  FramebufferSize size;
  glfwGetFramebufferSize(handle_, &size.width, &size.height);
  return size;
}

double Window::scale() const {
  float x = 1, y = 1;
  glfwGetWindowContentScale(handle_, &x, &y);
  return std::clamp(double{std::max(x, y)}, 0.5, 8.0);
}

bool Window::closing() const { return glfwWindowShouldClose(handle_); }
void Window::close() { glfwSetWindowShouldClose(handle_, GLFW_TRUE); }
void Window::wait(double seconds) const {
  if (seconds > 0) glfwWaitEventsTimeout(seconds);
  else glfwPollEvents();
}
void Window::wake() { glfwPostEmptyEvent(); }

}  // namespace arah
