#include "kernels/optimizer/chunks.h"

#include <fmt/format.h>

#include <stdexcept>

namespace arah {

uint64_t range_floats(const char* kernel, uint64_t bytes) {
  if (bytes % 256)
    throw std::invalid_argument(fmt::format("{}: a range of {} bytes is no multiple of 64 floats", kernel, bytes));
  return bytes / 4;
}

}  // namespace arah
