// Vulkan handles of a Device: included by the .cpp files of this folder alone.
#pragma once

#include <vulkan/vulkan.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "kernels/vulkan/device.h"
#include "kernels/vulkan/result.h"

namespace arah {

// A report with the handle that it speaks of.
struct SurveyedDevice {
  DeviceReport report;
  VkPhysicalDevice handle = VK_NULL_HANDLE;
};
std::vector<SurveyedDevice> survey(VkInstance instance);

VkInstance make_instance(bool validation, const std::vector<std::string>& window_extensions = {});

// Threads that make pipelines side by side, first come first served: a driver takes up to a second for one.
class PipelineMakers {
 public:
  ~PipelineMakers();  // drops what was not begun
  std::future<VkPipeline> begin(std::function<VkPipeline()> make);

 private:
  void work();
  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::packaged_task<VkPipeline()>> waiting_;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

struct DeviceState {
  VkInstance instance = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
  VkPhysicalDevice physical = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;
  uint32_t queue_family = 0;
  std::mutex queue_mutex;  // one thread at a time hands work to the queue (a window has one of its own)
  VkPhysicalDeviceMemoryProperties memory{};
  PFN_vkCmdPushDescriptorSetKHR push_descriptors = nullptr;
  DeviceReport report;
  Profiler profiler;
  bool host_memory_is_device_memory = false;  // CPU and integrated devices: map everything, stage nothing

  std::map<std::pair<std::string, std::vector<uint32_t>>, std::unique_ptr<Pipeline>> pipelines;
  std::map<const Pipeline*, std::future<VkPipeline>> making;  // those whose handle is on its way
  std::unique_ptr<PipelineMakers> makers = std::make_unique<PipelineMakers>();
  // Waits for the pipeline's handle. Throws what making it threw.
  void finish(const Pipeline& pipeline);
  VkPipelineCache pipeline_cache = VK_NULL_HANDLE;
  uint64_t pipelines_launched = 0;
  double pipeline_seconds = 0;
  std::function<void(const ShaderProgress&)> compiling;

  std::map<const Buffer*, std::pair<std::string, uint64_t>> buffers;  // what lives now, for the memory table
  uint64_t allocated_bytes = 0, most_allocated_bytes = 0;
  uint64_t memory_ceiling = 0;  // 0: none
  bool planning = false;        // inside Device::bytes_of: buffers are only counted
  uint64_t planned_bytes = 0;

  std::map<std::string, std::string> answers;  // Device::once

  std::mutex message_mutex;
  std::vector<std::string> messages;

  std::unique_ptr<Buffer> staging;  // discrete GPUs only, made on first use
};

// Adds the time that it lives to what compiling has taken, and says so to whoever listens.
class CompilationTimer {
 public:
  CompilationTimer(DeviceState& state, const std::string& shader);
  ~CompilationTimer();
  CompilationTimer(const CompilationTimer&) = delete;
  CompilationTimer& operator=(const CompilationTimer&) = delete;

 private:
  DeviceState& state_;
  const std::string& shader_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace arah
