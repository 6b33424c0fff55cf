// Vulkan handles of a Device: included by the .cpp files of this folder alone.
#pragma once

#include <vulkan/vulkan.h>

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "kernels/vulkan/device.h"

namespace arah {

// Throws std::runtime_error "<what>: VK_ERROR_…" unless the result is VK_SUCCESS.
void check(VkResult result, const std::string& what);
const char* to_string(VkResult result);

// A report with the handle that it speaks of.
struct SurveyedDevice {
  DeviceReport report;
  VkPhysicalDevice handle = VK_NULL_HANDLE;
};
std::vector<SurveyedDevice> survey(VkInstance instance);

VkInstance make_instance(bool validation);

struct DeviceState {
  VkInstance instance = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
  VkPhysicalDevice physical = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;
  uint32_t queue_family = 0;
  VkPhysicalDeviceMemoryProperties memory{};
  PFN_vkCmdPushDescriptorSetKHR push_descriptors = nullptr;
  DeviceReport report;
  Profiler profiler;
  bool host_memory_is_device_memory = false;  // CPU and integrated devices: map everything, stage nothing

  std::map<std::pair<std::string, std::vector<uint32_t>>, std::unique_ptr<Pipeline>> pipelines;
  VkPipelineCache pipeline_cache = VK_NULL_HANDLE;
  double pipeline_seconds = 0;

  std::map<const Buffer*, std::pair<std::string, uint64_t>> buffers;  // what lives now, for the memory table
  uint64_t allocated_bytes = 0;

  std::mutex message_mutex;
  std::vector<std::string> messages;

  std::unique_ptr<Buffer> staging;  // discrete GPUs only, made on first use
};

}  // namespace arah
