#include "host/capture/lzf.h"

#include <algorithm>

namespace arah {

std::vector<std::uint8_t> unpack_lzf(std::span<const std::uint8_t> packed, std::size_t most) {
  std::vector<std::uint8_t> bytes;
  bytes.reserve(std::min(most, 4 * packed.size()));
  for (std::size_t at = 0; at < packed.size();) {
    const std::size_t control = packed[at++];
    if (control < 32) {
      const std::size_t count = control + 1;
      if (count > packed.size() - at || count > most - bytes.size()) return {};
      bytes.insert(bytes.end(), packed.begin() + static_cast<std::ptrdiff_t>(at), packed.begin() + static_cast<std::ptrdiff_t>(at + count));
      at += count;
      continue;
    }
    std::size_t count = (control >> 5) + 2;
    if (count == 9 && at < packed.size()) count += packed[at++];
    if (at == packed.size()) return {};
    const std::size_t back = ((control & 31) << 8 | packed[at++]) + 1;
    if (back > bytes.size() || count > most - bytes.size()) return {};
    // One by one: what is repeated may be what this very loop appends.
    for (std::size_t from = bytes.size() - back, end = from + count; from < end; ++from) bytes.push_back(bytes[from]);
  }
  return bytes;
}

}  // namespace arah
