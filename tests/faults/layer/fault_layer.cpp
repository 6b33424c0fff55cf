// A Vulkan layer between the loader and the driver that makes the device fail once a file exists:
//   ARAH_FAULT_LOST=PATH       submitting and waiting answer VK_ERROR_DEVICE_LOST from then on
//   ARAH_FAULT_NO_MEMORY=PATH  allocating answers VK_ERROR_OUT_OF_DEVICE_MEMORY
// Everything else goes through. For a program with one instance and one device at a time. Layer interface version 2
// (Vulkan-Loader, LoaderLayerInterface.md).
#include <vulkan/vk_layer.h>
#include <vulkan/vulkan.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>

namespace {

PFN_vkGetInstanceProcAddr next_instance = nullptr;
PFN_vkGetDeviceProcAddr next_device = nullptr;
VkInstance instance = VK_NULL_HANDLE;
VkDevice device = VK_NULL_HANDLE;
bool lost = false;

bool exists(const char* variable) {
  const char* path = std::getenv(variable);
  return path && ::access(path, F_OK) == 0;
}

bool is_lost() {
  lost = lost || exists("ARAH_FAULT_LOST");
  return lost;
}

template <typename Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(next_device(device, name));
}

VKAPI_ATTR VkResult VKAPI_CALL submit(VkQueue queue, uint32_t count, const VkSubmitInfo* submits, VkFence fence) {
  return is_lost() ? VK_ERROR_DEVICE_LOST : next<PFN_vkQueueSubmit>("vkQueueSubmit")(queue, count, submits, fence);
}

VKAPI_ATTR VkResult VKAPI_CALL wait_for_fences(VkDevice of, uint32_t count, const VkFence* fences, VkBool32 all, uint64_t timeout) {
  // The work is waited for all the same, so that the driver is not torn down under it.
  const VkResult result = next<PFN_vkWaitForFences>("vkWaitForFences")(of, count, fences, all, timeout);
  return is_lost() ? VK_ERROR_DEVICE_LOST : result;
}

VKAPI_ATTR VkResult VKAPI_CALL allocate(VkDevice of, const VkMemoryAllocateInfo* info, const VkAllocationCallbacks* callbacks, VkDeviceMemory* memory) {
  return exists("ARAH_FAULT_NO_MEMORY") ? VK_ERROR_OUT_OF_DEVICE_MEMORY : next<PFN_vkAllocateMemory>("vkAllocateMemory")(of, info, callbacks, memory);
}

// The loader's link for this layer: the chain's entry of that type with what comes next.
template <typename Info>
Info* chain_link(const void* chain, VkStructureType type) {
  auto* info = static_cast<Info*>(const_cast<void*>(chain));
  while (info && !(info->sType == type && info->function == VK_LAYER_LINK_INFO)) info = static_cast<Info*>(const_cast<void*>(static_cast<const void*>(info->pNext)));
  return info;
}

VKAPI_ATTR VkResult VKAPI_CALL create_instance(const VkInstanceCreateInfo* info, const VkAllocationCallbacks* callbacks, VkInstance* made) {
  auto* link = chain_link<VkLayerInstanceCreateInfo>(info->pNext, VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO);
  if (!link) return VK_ERROR_INITIALIZATION_FAILED;
  next_instance = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
  link->u.pLayerInfo = link->u.pLayerInfo->pNext;
  const auto create = reinterpret_cast<PFN_vkCreateInstance>(next_instance(VK_NULL_HANDLE, "vkCreateInstance"));
  const VkResult result = create(info, callbacks, made);
  if (result == VK_SUCCESS) instance = *made;
  return result;
}

VKAPI_ATTR VkResult VKAPI_CALL create_device(VkPhysicalDevice physical, const VkDeviceCreateInfo* info, const VkAllocationCallbacks* callbacks, VkDevice* made) {
  auto* link = chain_link<VkLayerDeviceCreateInfo>(info->pNext, VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO);
  if (!link) return VK_ERROR_INITIALIZATION_FAILED;
  const PFN_vkGetInstanceProcAddr of_instance = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
  next_device = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
  link->u.pLayerInfo = link->u.pLayerInfo->pNext;
  const auto create = reinterpret_cast<PFN_vkCreateDevice>(of_instance(instance, "vkCreateDevice"));
  const VkResult result = create(physical, info, callbacks, made);
  if (result == VK_SUCCESS) device = *made;
  return result;
}

PFN_vkVoidFunction own(const char* name);

VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_function(VkDevice of, const char* name) {
  const PFN_vkVoidFunction found = own(name);
  return found ? found : next_device(of, name);
}

VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL instance_function(VkInstance of, const char* name) {
  const PFN_vkVoidFunction found = own(name);
  return found ? found : next_instance ? next_instance(of, name) : nullptr;
}

PFN_vkVoidFunction own(const char* name) {
  const struct {
    const char* name;
    PFN_vkVoidFunction function;
  } functions[] = {{"vkGetInstanceProcAddr", reinterpret_cast<PFN_vkVoidFunction>(instance_function)},
                   {"vkGetDeviceProcAddr", reinterpret_cast<PFN_vkVoidFunction>(device_function)},
                   {"vkCreateInstance", reinterpret_cast<PFN_vkVoidFunction>(create_instance)},
                   {"vkCreateDevice", reinterpret_cast<PFN_vkVoidFunction>(create_device)},
                   {"vkQueueSubmit", reinterpret_cast<PFN_vkVoidFunction>(submit)},
                   {"vkWaitForFences", reinterpret_cast<PFN_vkVoidFunction>(wait_for_fences)},
                   {"vkAllocateMemory", reinterpret_cast<PFN_vkVoidFunction>(allocate)}};
  for (const auto& function : functions)
    if (std::strcmp(function.name, name) == 0) return function.function;
  return nullptr;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) VKAPI_ATTR VkResult VKAPI_CALL vkNegotiateLoaderLayerInterfaceVersion(VkNegotiateLayerInterface* face) {
  if (face->loaderLayerInterfaceVersion < 2) return VK_ERROR_INITIALIZATION_FAILED;
  face->loaderLayerInterfaceVersion = 2;
  face->pfnGetInstanceProcAddr = instance_function;
  face->pfnGetDeviceProcAddr = device_function;
  face->pfnGetPhysicalDeviceProcAddr = nullptr;
  return VK_SUCCESS;
}
