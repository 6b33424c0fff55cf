// What a window needs of the device to present on it: its handles, and the lock of its queue.
#pragma once

#include <vulkan/vulkan.h>

#include <mutex>

#include "kernels/vulkan/device.h"

namespace arah {

struct WindowAccess {
  VkInstance instance = VK_NULL_HANDLE;
  VkPhysicalDevice physical = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;  // computes, draws, and presents where the surface lets it
  uint32_t queue_family = 0;
  std::mutex* queue_mutex = nullptr;  // held for each vkQueueSubmit, vkQueuePresentKHR and vk…WaitIdle
};

// The Device must have been opened with window_extensions, and outlive what is made of these.
WindowAccess window_access(Device& device);

}  // namespace arah
