#include "kernels/vulkan/cooperative_matrix.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "shaders/embedded.h"

namespace arah {
namespace {

constexpr const char* khr_name = "VK_KHR_cooperative_matrix";
constexpr const char* nv_name = VK_NV_COOPERATIVE_MATRIX_EXTENSION_NAME;

bool built_for_khr() { return std::strcmp(cooperative_matrix_extension(), khr_name) == 0; }

// Asked twice, as Vulkan's lists are: for their length, then for themselves.
template <typename Properties, typename Function>
std::vector<Properties> listed(VkInstance instance, VkPhysicalDevice device, const char* name, VkStructureType type) {
  const auto function = reinterpret_cast<Function>(vkGetInstanceProcAddr(instance, name));
  uint32_t count = 0;
  if (!function || function(device, &count, nullptr) != VK_SUCCESS) return {};
  Properties empty{};
  empty.sType = type;
  std::vector<Properties> list(count, empty);
  if (function(device, &count, list.data()) != VK_SUCCESS) return {};
  list.resize(count);
  return list;
}

// The feature, and whether compute shaders have it, by the structures of either extension.
template <typename Feature, typename Properties>
void ask(VkPhysicalDevice device, VkStructureType feature_type, VkStructureType properties_type, bool& has_feature, bool& in_compute) {
  Feature feature{};
  feature.sType = feature_type;
  VkPhysicalDeviceFeatures2 features{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &feature};
  vkGetPhysicalDeviceFeatures2(device, &features);
  has_feature = feature.cooperativeMatrix;
  Properties offered{};
  offered.sType = properties_type;
  VkPhysicalDeviceProperties2 properties{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, &offered};
  vkGetPhysicalDeviceProperties2(device, &properties);
  in_compute = offered.cooperativeMatrixSupportedStages & VK_SHADER_STAGE_COMPUTE_BIT;
}

bool switched_off() {
  const char* wanted = std::getenv("ARAH_COOPERATIVE");
  if (!wanted) return false;
  const std::string word = wanted;
  if (word != "on" && word != "off") throw std::invalid_argument("ARAH_COOPERATIVE: expected on or off, found '" + word + "'");
  return word == "off";
}

}  // namespace

std::string missing_for_cooperative_matrices(VkInstance instance, VkPhysicalDevice device, const std::vector<VkExtensionProperties>& extensions, const VkPhysicalDeviceVulkan12Features& features) {
  if (switched_off()) return "they are switched off by ARAH_COOPERATIVE=off";
  const std::string needed = cooperative_matrix_extension();
  const auto offers = [&](const std::string& name) { return std::any_of(extensions.begin(), extensions.end(), [&](const VkExtensionProperties& e) { return name == e.extensionName; }); };
  const bool khr = offers(khr_name), nv = offers(nv_name);
  const std::string offered = khr && nv ? "both extensions" : khr ? khr_name : nv ? nv_name : std::string("neither of the extensions");
  if (needed.empty()) return fmt::format("the shader compiler that built this program knows neither {} nor {}; the device offers {}", khr_name, nv_name, offered);
  if (!offers(needed)) return fmt::format("the kernel of this build is for {}; the device offers {}", needed, khr || nv ? offered : fmt::format("neither it nor {}", needed == nv_name ? khr_name : nv_name));

  bool has_feature = false, in_compute = false, has_size = false;
  if (built_for_khr()) {
#ifdef VK_KHR_cooperative_matrix
    ask<VkPhysicalDeviceCooperativeMatrixFeaturesKHR, VkPhysicalDeviceCooperativeMatrixPropertiesKHR>(device, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_KHR, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_PROPERTIES_KHR, has_feature,
                                                                                                       in_compute);
    for (const auto& p : listed<VkCooperativeMatrixPropertiesKHR, PFN_vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR>(instance, device, "vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR", VK_STRUCTURE_TYPE_COOPERATIVE_MATRIX_PROPERTIES_KHR))
      has_size |= p.MSize == 16 && p.NSize == 16 && p.KSize == 16 && p.AType == VK_COMPONENT_TYPE_FLOAT16_KHR && p.BType == VK_COMPONENT_TYPE_FLOAT16_KHR && p.CType == VK_COMPONENT_TYPE_FLOAT32_KHR && p.ResultType == VK_COMPONENT_TYPE_FLOAT32_KHR &&
                  p.scope == VK_SCOPE_SUBGROUP_KHR;
#endif
  } else {
    ask<VkPhysicalDeviceCooperativeMatrixFeaturesNV, VkPhysicalDeviceCooperativeMatrixPropertiesNV>(device, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_NV, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_PROPERTIES_NV, has_feature,
                                                                                                     in_compute);
    for (const auto& p : listed<VkCooperativeMatrixPropertiesNV, PFN_vkGetPhysicalDeviceCooperativeMatrixPropertiesNV>(instance, device, "vkGetPhysicalDeviceCooperativeMatrixPropertiesNV", VK_STRUCTURE_TYPE_COOPERATIVE_MATRIX_PROPERTIES_NV))
      has_size |= p.MSize == 16 && p.NSize == 16 && p.KSize == 16 && p.AType == VK_COMPONENT_TYPE_FLOAT16_NV && p.BType == VK_COMPONENT_TYPE_FLOAT16_NV && p.CType == VK_COMPONENT_TYPE_FLOAT32_NV && p.DType == VK_COMPONENT_TYPE_FLOAT32_NV &&
                  p.scope == VK_SCOPE_SUBGROUP_NV;
  }
  std::vector<std::string> missing;
  if (!has_feature) missing.push_back("cooperativeMatrix");
  if (!in_compute) missing.push_back("cooperative matrices in compute shaders");
  if (!has_size) missing.push_back("matrices of 16 x 16 x 16 halves with float32 sums, held by a subgroup");
  if (!features.shaderFloat16) missing.push_back("shaderFloat16");
  if (!features.vulkanMemoryModel) missing.push_back("vulkanMemoryModel");
  return missing.empty() ? "" : fmt::format("the device has {}, but not {}", needed, fmt::join(missing, ", "));
}

CooperativeMatrixFeature::CooperativeMatrixFeature() : nv_{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_NV} {
  nv_.cooperativeMatrix = VK_TRUE;
#ifdef VK_KHR_cooperative_matrix
  khr_ = {};
  khr_.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_KHR;
  khr_.cooperativeMatrix = VK_TRUE;
#endif
}

void* CooperativeMatrixFeature::chained() {
#ifdef VK_KHR_cooperative_matrix
  if (built_for_khr()) return &khr_;
#endif
  return &nv_;
}

}  // namespace arah
