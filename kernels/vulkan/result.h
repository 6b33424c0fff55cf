// What Vulkan's calls return, as errors.
#pragma once

#include <vulkan/vulkan.h>

#include <string>

namespace arah {

// Throws std::runtime_error "<what>: VK_ERROR_…" unless the result is VK_SUCCESS.
void check(VkResult result, const std::string& what);
const char* to_string(VkResult result);

}  // namespace arah
