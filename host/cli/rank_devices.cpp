#include "host/cli/rank_devices.h"

#include <fmt/format.h>

#include <vector>

namespace arah {

std::string unequal_devices(const Ranks& ranks, const Device& device) {
  const std::vector<std::string> all = ranks.gather(fmt::format("{} ({})", device.report().name, device.report().driver));
  for (std::size_t r = 1; r < all.size(); ++r)
    if (all[r] != all[0]) return fmt::format("note: rank {} computes on {}, rank 0 on {}: what they make may differ from one rank's in last bits", r, all[r], all[0]);
  return "";
}

}  // namespace arah
