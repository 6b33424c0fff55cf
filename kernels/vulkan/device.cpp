#include "kernels/vulkan/device.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "kernels/vulkan/commands.h"
#include "kernels/vulkan/cooperative_matrix.h"
#include "kernels/vulkan/device_state.h"
#include "kernels/vulkan/window_access.h"
#include "shaders/embedded.h"

namespace arah {
namespace {

VKAPI_ATTR VkBool32 VKAPI_CALL keep_message(VkDebugUtilsMessageSeverityFlagBitsEXT, VkDebugUtilsMessageTypeFlagsEXT,
                                            const VkDebugUtilsMessengerCallbackDataEXT* data, void* user) {
  auto* state = static_cast<DeviceState*>(user);
  const std::lock_guard lock(state->message_mutex);
  state->messages.emplace_back(data->pMessage);
  return VK_FALSE;
}

VkDebugUtilsMessengerCreateInfoEXT messenger_info(DeviceState* state) {
  VkDebugUtilsMessengerCreateInfoEXT info{VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT};
  info.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
  info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT;
  info.pfnUserCallback = keep_message;
  info.pUserData = state;
  return info;
}

// Order of preference where nothing is asked for.
int preference(DeviceType type) {
  switch (type) {
    case DeviceType::discrete_gpu: return 0;
    case DeviceType::integrated_gpu: return 1;
    case DeviceType::virtual_gpu: return 2;
    case DeviceType::cpu: return 3;
    case DeviceType::other: return 4;
  }
  return 4;
}

SurveyedDevice choose(VkInstance instance, const std::string& wanted) {
  std::vector<SurveyedDevice> devices = survey(instance);
  std::string reasons;
  std::vector<const SurveyedDevice*> fit;
  for (const SurveyedDevice& device : devices) {
    const bool named = wanted.empty() || wanted == std::to_string(device.report.index) || device.report.name.find(wanted) != std::string::npos;
    if (named && device.report.usable()) {
      fit.push_back(&device);
      continue;
    }
    reasons += fmt::format("\n  {} {}: ", device.report.index, device.report.name);
    if (!named) reasons += fmt::format("not the wanted '{}'", wanted);
    for (const std::string& refusal : device.report.refusals) reasons += refusal + "; ";
  }
  if (fit.empty())
    throw std::runtime_error(fmt::format("no usable Vulkan device{}. On a machine without a GPU install Mesa's CPU device: apt-get install mesa-vulkan-drivers",
                                         devices.empty() ? ": the Vulkan loader lists none" : reasons));
  return **std::min_element(fit.begin(), fit.end(), [](const auto* a, const auto* b) { return preference(a->report.type) < preference(b->report.type); });
}

// In units of 1024 as --memory takes them: "12.5M".
std::string size_text(uint64_t bytes) { return fmt::format("{:.1f}M", double(bytes) / (1 << 20)); }

}  // namespace

VkInstance make_instance(bool validation, const std::vector<std::string>& window_extensions) {
  VkApplicationInfo application{VK_STRUCTURE_TYPE_APPLICATION_INFO};
  application.pApplicationName = "arah";
  application.apiVersion = VK_API_VERSION_1_2;
  VkInstanceCreateInfo info{VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO};
  info.pApplicationInfo = &application;
  const char* layer = "VK_LAYER_KHRONOS_validation";
  std::vector<const char*> extensions;
  for (const std::string& extension : window_extensions) extensions.push_back(extension.c_str());
  const VkValidationFeatureEnableEXT synchronisation = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT;
  VkValidationFeaturesEXT features{VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT};
  features.enabledValidationFeatureCount = 1;
  features.pEnabledValidationFeatures = &synchronisation;
  if (validation) {
    info.pNext = &features;
    info.enabledLayerCount = 1;
    info.ppEnabledLayerNames = &layer;
    extensions.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
    extensions.push_back(VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME);
  }
  info.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  VkInstance instance = VK_NULL_HANDLE;
  check(vkCreateInstance(&info, nullptr, &instance), "starting Vulkan");
  return instance;
}

DeviceOptions DeviceOptions::from_environment() {
  DeviceOptions options;
  if (const char* wanted = std::getenv("ARAH_DEVICE")) options.wanted = wanted;
  if (const char* validation = std::getenv("ARAH_VALIDATION")) options.validation = std::strcmp(validation, "0") != 0;
  return options;
}

Device::Device(const DeviceOptions& options) : state_(std::make_unique<DeviceState>()) {
  DeviceState& s = *state_;
  const bool presents = !options.window_extensions.empty();
  s.instance = make_instance(options.validation, options.window_extensions);
  if (options.validation) {
    const auto create = reinterpret_cast<PFN_vkCreateDebugUtilsMessengerEXT>(vkGetInstanceProcAddr(s.instance, "vkCreateDebugUtilsMessengerEXT"));
    const auto info = messenger_info(&s);
    if (create) check(create(s.instance, &info, nullptr, &s.messenger), "listening to the validation layer");
  }
  SurveyedDevice chosen = choose(s.instance, options.wanted);
  s.physical = chosen.handle;
  s.report = chosen.report;
  s.profiler.enabled = options.profile && s.report.timestamp_period_ns > 0;
  s.memory_ceiling = options.memory_ceiling;
  s.compiling = options.compiling;
  s.host_memory_is_device_memory = s.report.type == DeviceType::cpu || s.report.type == DeviceType::integrated_gpu;
  vkGetPhysicalDeviceMemoryProperties(s.physical, &s.memory);

  uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(s.physical, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(s.physical, &count, families.data());
  const VkQueueFlags work = VK_QUEUE_COMPUTE_BIT | (presents ? VK_QUEUE_GRAPHICS_BIT : 0);
  while (s.queue_family < count && (families[s.queue_family].queueFlags & work) != work) ++s.queue_family;
  if (s.queue_family == count) throw std::runtime_error(fmt::format("{} has no queue that both computes and draws, as a window needs; ARAH_DEVICE or --device chooses another", s.report.name));

  const float priority = 1;
  VkDeviceQueueCreateInfo queue{VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO};
  queue.queueFamilyIndex = s.queue_family;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  VkPhysicalDeviceVulkan12Features features12{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
  features12.bufferDeviceAddress = VK_TRUE;
  features12.scalarBlockLayout = VK_TRUE;
  VkPhysicalDeviceFeatures2 features{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &features12};
  features.features.shaderInt64 = VK_TRUE;
  std::vector<const char*> extensions{VK_KHR_PUSH_DESCRIPTOR_EXTENSION_NAME};
  if (presents) extensions.push_back(VK_KHR_SWAPCHAIN_EXTENSION_NAME);
  CooperativeMatrixFeature cooperative;
  if (s.report.cooperative_matrix_missing.empty()) {
    extensions.push_back(cooperative_matrix_extension());
    features12.shaderFloat16 = features12.vulkanMemoryModel = VK_TRUE;
    features12.pNext = cooperative.chained();
  }
  VkDeviceCreateInfo info{VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, &features};
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  info.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  check(vkCreateDevice(s.physical, &info, nullptr, &s.device), "opening " + s.report.name);
  vkGetDeviceQueue(s.device, s.queue_family, 0, &s.queue);
  s.push_descriptors = reinterpret_cast<PFN_vkCmdPushDescriptorSetKHR>(vkGetDeviceProcAddr(s.device, "vkCmdPushDescriptorSetKHR"));
  VkPipelineCacheCreateInfo cache{VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO};
  check(vkCreatePipelineCache(s.device, &cache, nullptr, &s.pipeline_cache), "making the pipeline cache");
}

PipelineMakers::~PipelineMakers() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

std::future<VkPipeline> PipelineMakers::begin(std::function<VkPipeline()> make) {
  const std::lock_guard lock(mutex_);
  waiting_.emplace_back(std::move(make));
  if (threads_.size() < std::clamp(std::thread::hardware_concurrency(), 1u, 8u)) threads_.emplace_back([this] { work(); });
  wake_.notify_one();
  return waiting_.back().get_future();
}

void PipelineMakers::work() {
  for (;;) {
    std::packaged_task<VkPipeline()> task;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [this] { return stopping_ || !waiting_.empty(); });
      if (stopping_) return;
      task = std::move(waiting_.front());
      waiting_.pop_front();
    }
    task();
  }
}

void DeviceState::finish(const Pipeline& pipeline) {
  const auto found = making.find(&pipeline);
  if (found == making.end()) return;
  const auto owned = std::find_if(pipelines.begin(), pipelines.end(), [&](const auto& entry) { return entry.second.get() == &pipeline; });
  std::future<VkPipeline> handle = std::move(found->second);
  making.erase(found);
  owned->second->handle = handle.get();
}

Device::~Device() {
  DeviceState& s = *state_;
  s.staging.reset();
  s.makers.reset();
  for (auto& [key, pipeline] : s.pipelines) {
    try {
      s.finish(*pipeline);
    } catch (const std::exception&) {  // not begun, or refused by the driver: there is no handle
    }
  }
  if (s.device) vkDeviceWaitIdle(s.device);
  for (auto& [key, pipeline] : s.pipelines) {
    vkDestroyPipeline(s.device, pipeline->handle, nullptr);
    vkDestroyPipelineLayout(s.device, pipeline->layout, nullptr);
    vkDestroyDescriptorSetLayout(s.device, pipeline->set_layout, nullptr);
  }
  if (s.pipeline_cache) vkDestroyPipelineCache(s.device, s.pipeline_cache, nullptr);
  if (s.device) vkDestroyDevice(s.device, nullptr);
  if (s.messenger) {
    const auto destroy = reinterpret_cast<PFN_vkDestroyDebugUtilsMessengerEXT>(vkGetInstanceProcAddr(s.instance, "vkDestroyDebugUtilsMessengerEXT"));
    destroy(s.instance, s.messenger, nullptr);
  }
  if (s.instance) vkDestroyInstance(s.instance, nullptr);
}

const DeviceReport& Device::report() const { return state_->report; }
Profiler& Device::profiler() { return state_->profiler; }

WindowAccess window_access(Device& device) {
  DeviceState& s = device.state();
  return {s.instance, s.physical, s.device, s.queue, s.queue_family, &s.queue_mutex};
}

const std::string& Device::once(const std::string& question, const std::function<std::string()>& ask) {
  const auto known = state_->answers.find(question);
  if (known != state_->answers.end()) return known->second;
  return state_->answers[question] = ask();
}

uint64_t Device::allocated_bytes() const { return state_->allocated_bytes; }
uint64_t Device::most_allocated_bytes() const { return state_->most_allocated_bytes; }
uint64_t Device::memory_ceiling() const { return state_->memory_ceiling; }
uint64_t Device::pipelines_made() const { return state_->pipelines.size(); }
double Device::pipeline_seconds() const { return state_->pipeline_seconds; }

std::vector<std::string> Device::validation_messages() const {
  const std::lock_guard lock(state_->message_mutex);
  return state_->messages;
}

std::string Device::memory_table() const {
  std::vector<std::pair<std::string, uint64_t>> rows;
  for (const auto& [buffer, entry] : state_->buffers) rows.push_back(entry);
  std::sort(rows.begin(), rows.end(), [](const auto& a, const auto& b) { return a.second != b.second ? a.second > b.second : a.first < b.first; });
  std::string text;
  for (const auto& [name, bytes] : rows) text += fmt::format("{:>12.3f} MB  {}\n", double(bytes) * 1e-6, name);
  return text + fmt::format("{:>12.3f} MB  in all\n", double(state_->allocated_bytes) * 1e-6);
}

uint64_t Device::bytes_of(const std::function<void()>& make) {
  struct Planning {
    DeviceState& state;
    explicit Planning(DeviceState& s) : state(s) { state.planning = true, state.planned_bytes = 0; }
    ~Planning() { state.planning = false; }
  } planning(*state_);
  make();
  return state_->planned_bytes;
}

MemoryCeilingError Device::beyond_ceiling(const std::string& what, uint64_t needed) const {
  const DeviceState& s = *state_;
  // By what stands before the colon of a buffer's name.
  std::map<std::string, uint64_t> parts;
  for (const auto& [buffer, entry] : s.buffers) parts[entry.first.substr(0, entry.first.find(':'))] += entry.second;
  std::vector<std::pair<uint64_t, std::string>> largest;
  for (const auto& [name, bytes] : parts) largest.emplace_back(bytes, name);
  std::sort(largest.rbegin(), largest.rend());
  constexpr size_t named = 4;
  std::string holders;
  for (size_t i = 0; i < std::min(named, largest.size()); ++i) holders += fmt::format("{}{} {}", i ? ", " : ": ", size_text(largest[i].first), largest[i].second);
  if (largest.size() > named) holders += " and others";
  return MemoryCeilingError(fmt::format("{}: asks for {}, the memory ceiling is {}, of which {} are held{}. A ceiling of {}M would do for this: give --memory that much or more.", what, size_text(needed),
                                        size_text(s.memory_ceiling), size_text(s.allocated_bytes), holders, (s.allocated_bytes + needed + (1 << 20) - 1) >> 20));
}

CompilationTimer::CompilationTimer(DeviceState& state, const std::string& shader) : state_(state), shader_(shader) {
  if (state_.compiling) state_.compiling({shader_, false, state_.pipelines.size(), state_.pipelines_launched, state_.pipeline_seconds});
}

CompilationTimer::~CompilationTimer() {
  state_.pipeline_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  state_.pipelines_launched += 1;
  if (state_.compiling) state_.compiling({shader_, true, state_.pipelines.size(), state_.pipelines_launched, state_.pipeline_seconds});
}

const Pipeline& Device::pipeline(const std::string& shader, const std::vector<uint32_t>& specialization) {
  DeviceState& s = *state_;
  std::unique_ptr<Pipeline>& slot = s.pipelines[{shader, specialization}];
  if (slot) return *slot;

  const EmbeddedShader* found = embedded_shaders();
  while (found->name && shader != found->name) ++found;
  if (!found->name) {
    s.pipelines.erase({shader, specialization});
    throw std::invalid_argument("no shader named '" + shader + "' is embedded in this program");
  }
  const size_t bytes = static_cast<size_t>(found->end - found->begin);
  std::vector<uint32_t> words(bytes / 4);
  std::memcpy(words.data(), found->begin, bytes);

  auto pipeline = std::make_unique<Pipeline>();
  pipeline->name = shader;
  pipeline->interface = reflect_spirv(words.data(), words.size(), specialization);
  const ShaderInterface& face = pipeline->interface;
  const uint64_t invocations = uint64_t(face.local_size[0]) * face.local_size[1] * face.local_size[2];
  if (invocations > s.report.max_workgroup_invocations)
    throw std::runtime_error(fmt::format("shader {}: asks for {} invocations in a workgroup, {} offers {}", shader, invocations, s.report.name, s.report.max_workgroup_invocations));

  std::vector<VkDescriptorSetLayoutBinding> bindings;
  for (const ShaderBinding& binding : face.bindings) {
    VkDescriptorType type = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    if (binding.type == BindingType::uniform_buffer) type = VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER;
    if (binding.type == BindingType::storage_texel_buffer) type = VK_DESCRIPTOR_TYPE_STORAGE_TEXEL_BUFFER;
    if (binding.type == BindingType::uniform_texel_buffer) type = VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER;
    bindings.push_back({binding.binding, type, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr});
  }
  VkDescriptorSetLayoutCreateInfo set{VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO};
  set.flags = VK_DESCRIPTOR_SET_LAYOUT_CREATE_PUSH_DESCRIPTOR_BIT_KHR;
  set.bindingCount = static_cast<uint32_t>(bindings.size());
  set.pBindings = bindings.data();
  check(vkCreateDescriptorSetLayout(s.device, &set, nullptr, &pipeline->set_layout), "descriptor layout of " + shader);
  const VkPushConstantRange range{VK_SHADER_STAGE_COMPUTE_BIT, 0, face.push_constant_bytes};
  VkPipelineLayoutCreateInfo layout{VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO};
  layout.setLayoutCount = 1;
  layout.pSetLayouts = &pipeline->set_layout;
  layout.pushConstantRangeCount = face.push_constant_bytes ? 1 : 0;
  layout.pPushConstantRanges = &range;
  check(vkCreatePipelineLayout(s.device, &layout, nullptr, &pipeline->layout), "pipeline layout of " + shader);

  slot = std::move(pipeline);
  s.making[slot.get()] = s.makers->begin([device = s.device, cache = s.pipeline_cache, layout = slot->layout, shader, specialization, words = std::move(words)] {
    VkShaderModuleCreateInfo module_info{VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO};
    module_info.codeSize = words.size() * 4;
    module_info.pCode = words.data();
    VkShaderModule module = VK_NULL_HANDLE;
    check(vkCreateShaderModule(device, &module_info, nullptr, &module), "shader module " + shader);
    std::vector<VkSpecializationMapEntry> entries;
    for (uint32_t i = 0; i < specialization.size(); ++i) entries.push_back({i, i * 4, 4});
    const VkSpecializationInfo special{static_cast<uint32_t>(entries.size()), entries.data(), specialization.size() * 4, specialization.data()};
    VkComputePipelineCreateInfo info{VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO};
    info.stage = {VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO, nullptr, 0, VK_SHADER_STAGE_COMPUTE_BIT, module, "main", &special};
    info.layout = layout;
    VkPipeline handle = VK_NULL_HANDLE;
    const VkResult result = vkCreateComputePipelines(device, cache, 1, &info, nullptr, &handle);
    vkDestroyShaderModule(device, module, nullptr);
    check(result, "compiling shader " + shader);
    return handle;
  });
  return *slot;
}

void Device::upload(const BufferSlice& to, const void* from, uint64_t bytes) {
  if (bytes > to.bytes) throw std::out_of_range(fmt::format("upload of {} bytes into {} bytes of '{}'", bytes, to.bytes, to.buffer ? to.buffer->name() : "nothing"));
  if (bytes == 0 || state_->planning) return;
  if (to.buffer->mapped()) {
    std::memcpy(static_cast<std::byte*>(to.buffer->mapped()) + to.offset, from, bytes);
    return;
  }
  if (!state_->staging) state_->staging = std::make_unique<Buffer>(*this, "staging", 16 << 20, BufferPlace::shared);
  Commands commands(*this);
  for (uint64_t at = 0; at < bytes;) {
    const uint64_t piece = std::min(bytes - at, state_->staging->bytes());
    std::memcpy(state_->staging->mapped(), static_cast<const std::byte*>(from) + at, piece);
    commands.copy(state_->staging->slice().sub(0, piece), to.sub(at, piece));
    commands.submit_and_wait();
    at += piece;
  }
}

void Device::download(const BufferSlice& from, void* to, uint64_t bytes) {
  if (bytes > from.bytes) throw std::out_of_range(fmt::format("download of {} bytes from {} bytes of '{}'", bytes, from.bytes, from.buffer ? from.buffer->name() : "nothing"));
  if (bytes == 0) return;
  if (state_->planning) {
    std::memset(to, 0, bytes);
    return;
  }
  if (from.buffer->mapped()) {
    std::memcpy(to, static_cast<const std::byte*>(from.buffer->mapped()) + from.offset, bytes);
    return;
  }
  if (!state_->staging) state_->staging = std::make_unique<Buffer>(*this, "staging", 16 << 20, BufferPlace::shared);
  Commands commands(*this);
  for (uint64_t at = 0; at < bytes;) {
    const uint64_t piece = std::min(bytes - at, state_->staging->bytes());
    commands.copy(from.sub(at, piece), state_->staging->slice().sub(0, piece));
    commands.submit_and_wait();
    std::memcpy(static_cast<std::byte*>(to) + at, state_->staging->mapped(), piece);
    at += piece;
  }
}

}  // namespace arah
