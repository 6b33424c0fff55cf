// How many rays go together where the device has a memory ceiling (DeviceOptions::memory_ceiling).
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "kernels/vulkan/device.h"

namespace arah {

// The most rays, `most` itself or a multiple of 64 below, for which what `make` makes, and `besides` bytes that come later, fit
// what the ceiling leaves now; `most` without a ceiling. make(rays) runs several times without memory (Device::bytes_of) and
// must need no less for more rays. Throws MemoryCeilingError naming `what` and the least ceiling that would do where 64 rays are
// too many.
uint32_t rays_that_fit(Device& device, const std::string& what, uint32_t most, uint64_t besides, const std::function<void(uint32_t rays)>& make);

}  // namespace arah
