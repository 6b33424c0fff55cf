// Whether a device can run linear/cooperative_forward, and what a device must be opened with for it.
// Included by the .cpp files of this folder alone.
#pragma once

#include <vulkan/vulkan.h>

#include <string>
#include <vector>

namespace arah {

// What is missing, in words; "" where nothing is: the extension that this build's kernel is for, 16 × 16 × 16 halves with float32
// sums held by a subgroup in compute shaders, 16-bit floats and Vulkan's memory model. ARAH_COOPERATIVE=off misses all of it.
// Throws std::invalid_argument where that variable is neither on nor off. extensions: of the device; features: asked from it.
std::string missing_for_cooperative_matrices(VkInstance instance, VkPhysicalDevice device, const std::vector<VkExtensionProperties>& extensions, const VkPhysicalDeviceVulkan12Features& features);

// The extension's feature, switched on, for the device's creation.
class CooperativeMatrixFeature {
 public:
  CooperativeMatrixFeature();
  void* chained();  // lives as long as this

 private:
  VkPhysicalDeviceCooperativeMatrixFeaturesNV nv_;
#ifdef VK_KHR_cooperative_matrix
  VkPhysicalDeviceCooperativeMatrixFeaturesKHR khr_;
#endif
};

}  // namespace arah
