// What ranks tell of their devices before they make pictures together.
#pragma once

#include <string>

#include "host/training/ranks.h"
#include "kernels/vulkan/device.h"

namespace arah {

// Collective: a line to show where the ranks' devices are of several kinds, whose pictures may differ in last bits; empty where they are
// of one.
std::string unequal_devices(const Ranks& ranks, const Device& device);

}  // namespace arah
