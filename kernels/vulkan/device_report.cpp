#include "kernels/vulkan/device_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "kernels/vulkan/cooperative_matrix.h"
#include "kernels/vulkan/device_state.h"

namespace arah {

const char* to_string(DeviceType type) {
  switch (type) {
    case DeviceType::cpu: return "CPU";
    case DeviceType::integrated_gpu: return "integrated GPU";
    case DeviceType::discrete_gpu: return "discrete GPU";
    case DeviceType::virtual_gpu: return "virtual GPU";
    case DeviceType::other: return "other";
  }
  return "other";
}

const char* to_string(VkResult result) {
  switch (result) {
    case VK_ERROR_OUT_OF_HOST_MEMORY: return "VK_ERROR_OUT_OF_HOST_MEMORY";
    case VK_ERROR_OUT_OF_DEVICE_MEMORY: return "VK_ERROR_OUT_OF_DEVICE_MEMORY";
    case VK_ERROR_DEVICE_LOST: return "VK_ERROR_DEVICE_LOST (the device or its driver has stopped; the system's log may say why)";
    case VK_ERROR_INITIALIZATION_FAILED: return "VK_ERROR_INITIALIZATION_FAILED";
    case VK_ERROR_LAYER_NOT_PRESENT: return "VK_ERROR_LAYER_NOT_PRESENT (is the package vulkan-validationlayers installed?)";
    case VK_ERROR_EXTENSION_NOT_PRESENT: return "VK_ERROR_EXTENSION_NOT_PRESENT";
    case VK_ERROR_FEATURE_NOT_PRESENT: return "VK_ERROR_FEATURE_NOT_PRESENT";
    case VK_ERROR_INCOMPATIBLE_DRIVER: return "VK_ERROR_INCOMPATIBLE_DRIVER";
    default: return "an error without a name here";
  }
}

void check(VkResult result, const std::string& what) {
  if (result != VK_SUCCESS) throw std::runtime_error(fmt::format("{}: {} ({})", what, to_string(result), static_cast<int>(result)));
}

namespace {

std::string version_text(uint32_t version) {
  return fmt::format("{}.{}.{}", VK_API_VERSION_MAJOR(version), VK_API_VERSION_MINOR(version), VK_API_VERSION_PATCH(version));
}

DeviceType device_type(VkPhysicalDeviceType type) {
  switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_CPU: return DeviceType::cpu;
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU: return DeviceType::integrated_gpu;
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU: return DeviceType::discrete_gpu;
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU: return DeviceType::virtual_gpu;
    default: return DeviceType::other;
  }
}

SurveyedDevice survey_one(VkInstance instance, VkPhysicalDevice handle, uint32_t index) {
  SurveyedDevice result;
  result.handle = handle;
  DeviceReport& report = result.report;

  VkPhysicalDeviceDriverProperties driver{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES};
  VkPhysicalDeviceSubgroupProperties subgroup{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES, &driver};
  VkPhysicalDeviceMaintenance3Properties maintenance{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES, &subgroup};
  VkPhysicalDeviceProperties2 properties{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, &maintenance};
  vkGetPhysicalDeviceProperties2(handle, &properties);
  const VkPhysicalDeviceLimits& limits = properties.properties.limits;

  report.index = index;
  report.name = properties.properties.deviceName;
  report.driver = fmt::format("{} {}", driver.driverName, driver.driverInfo);
  report.api_version = version_text(properties.properties.apiVersion);
  report.type = device_type(properties.properties.deviceType);
  report.max_storage_buffer_bytes = limits.maxStorageBufferRange;
  report.max_allocation_bytes = maintenance.maxMemoryAllocationSize;
  report.max_texel_elements = limits.maxTexelBufferElements;
  report.buffer_offset_alignment = std::max({limits.minStorageBufferOffsetAlignment, limits.minTexelBufferOffsetAlignment,
                                             limits.minUniformBufferOffsetAlignment, VkDeviceSize(16)});
  report.max_workgroup_invocations = limits.maxComputeWorkGroupInvocations;
  report.max_workgroups_x = limits.maxComputeWorkGroupCount[0];
  report.max_shared_bytes = limits.maxComputeSharedMemorySize;
  report.max_push_constant_bytes = limits.maxPushConstantsSize;
  report.subgroup_size = subgroup.subgroupSize;

  VkPhysicalDeviceMemoryProperties memory;
  vkGetPhysicalDeviceMemoryProperties(handle, &memory);
  for (uint32_t i = 0; i < memory.memoryHeapCount; ++i)
    if (memory.memoryHeaps[i].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) report.heap_bytes = std::max(report.heap_bytes, memory.memoryHeaps[i].size);

  auto refuse = [&](const std::string& asked, const std::string& offered) {
    report.refusals.push_back(fmt::format("needs {}; the device offers {}", asked, offered));
  };
  if (properties.properties.apiVersion < VK_API_VERSION_1_2) {
    refuse("Vulkan 1.2", report.api_version);
    return result;  // the feature structures below belong to 1.2
  }

  VkPhysicalDeviceVulkan12Features features12{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
  VkPhysicalDeviceFeatures2 features{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &features12};
  vkGetPhysicalDeviceFeatures2(handle, &features);
  if (!features12.bufferDeviceAddress) refuse("bufferDeviceAddress (weights are read by address)", "none");
  if (!features12.scalarBlockLayout) refuse("scalarBlockLayout (structures shared by C++ and GLSL)", "none");
  if (!features.features.shaderInt64) refuse("shaderInt64 (buffer addresses, wide stores)", "none");

  uint32_t count = 0;
  vkEnumerateDeviceExtensionProperties(handle, nullptr, &count, nullptr);
  std::vector<VkExtensionProperties> extensions(count);
  vkEnumerateDeviceExtensionProperties(handle, nullptr, &count, extensions.data());
  const bool push = std::any_of(extensions.begin(), extensions.end(), [](const VkExtensionProperties& e) {
    return std::strcmp(e.extensionName, VK_KHR_PUSH_DESCRIPTOR_EXTENSION_NAME) == 0;
  });
  if (!push) refuse(VK_KHR_PUSH_DESCRIPTOR_EXTENSION_NAME, "no such extension");
  report.cooperative_matrix_missing = missing_for_cooperative_matrices(instance, handle, extensions, features12);

  for (const auto& [format, name] : {std::pair{VK_FORMAT_R32G32B32A32_SFLOAT, "rgba32f"}, {VK_FORMAT_R32G32B32A32_UINT, "rgba32ui"}}) {
    VkFormatProperties texel;
    vkGetPhysicalDeviceFormatProperties(handle, format, &texel);
    if (!(texel.bufferFeatures & VK_FORMAT_FEATURE_STORAGE_TEXEL_BUFFER_BIT)) refuse(fmt::format("{} storage texel buffers", name), "none");
  }

  const VkSubgroupFeatureFlags wanted = VK_SUBGROUP_FEATURE_SHUFFLE_BIT;
  if ((subgroup.supportedOperations & wanted) != wanted || !(subgroup.supportedStages & VK_SHADER_STAGE_COMPUTE_BIT) || subgroup.subgroupSize < 8)
    refuse("subgroup shuffles over 8 lanes or more in compute", fmt::format("subgroups of {}", subgroup.subgroupSize));
  if (limits.maxPushConstantsSize < 128) refuse("128 bytes of push constants", std::to_string(limits.maxPushConstantsSize));
  if (limits.maxComputeWorkGroupInvocations < 256) refuse("256 invocations in a workgroup", std::to_string(limits.maxComputeWorkGroupInvocations));

  count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(handle, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(handle, &count, families.data());
  const auto family = std::find_if(families.begin(), families.end(), [](const auto& f) { return f.queueFlags & VK_QUEUE_COMPUTE_BIT; });
  if (family == families.end()) {
    refuse("a compute queue", "none");
  } else if (family->timestampValidBits > 0) {
    report.timestamp_period_ns = limits.timestampPeriod;
  }
  return result;
}

}  // namespace

std::vector<SurveyedDevice> survey(VkInstance instance) {
  uint32_t count = 0;
  check(vkEnumeratePhysicalDevices(instance, &count, nullptr), "listing Vulkan devices");
  std::vector<VkPhysicalDevice> handles(count);
  check(vkEnumeratePhysicalDevices(instance, &count, handles.data()), "listing Vulkan devices");
  std::vector<SurveyedDevice> devices;
  for (uint32_t i = 0; i < count; ++i) devices.push_back(survey_one(instance, handles[i], i));
  return devices;
}

std::vector<DeviceReport> survey_devices() {
  const VkInstance instance = make_instance(false);
  std::vector<DeviceReport> reports;
  try {
    for (SurveyedDevice& device : survey(instance)) reports.push_back(std::move(device.report));
  } catch (...) {
    vkDestroyInstance(instance, nullptr);
    throw;
  }
  vkDestroyInstance(instance, nullptr);
  return reports;
}

}  // namespace arah
