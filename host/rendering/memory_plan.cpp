#include "host/rendering/memory_plan.h"

#include <algorithm>

namespace arah {

uint32_t rays_that_fit(Device& device, const std::string& what, uint32_t most, uint64_t besides, const std::function<void(uint32_t rays)>& make) {
  if (!device.memory_ceiling()) return most;
  constexpr uint32_t step = 64;  // rays are padded to it
  const uint64_t left = device.memory_ceiling() - device.allocated_bytes();
  const auto bytes = [&](uint32_t rays) { return besides + device.bytes_of([&] { make(rays); }); };
  if (bytes(most) <= left) return most;
  const uint64_t least = bytes(std::min(step, most));
  if (least > left) throw device.beyond_ceiling(what, least);
  uint32_t fits = 1, too_many = (most + step - 1) / step;  // in steps
  while (too_many - fits > 1) {
    const uint32_t middle = fits + (too_many - fits) / 2;
    (bytes(middle * step) <= left ? fits : too_many) = middle;
  }
  return fits * step;
}

}  // namespace arah
