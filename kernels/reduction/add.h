// y += x over ranges of the flat parameter buffers.
#pragma once

#include "kernels/vulkan/commands.h"

namespace arah {

// Both: float, the same multiple of 64 of them; may exceed what is bound at once. Throws std::invalid_argument otherwise.
void record_add(Commands& commands, const BufferSlice& x, const BufferSlice& y, const char* name);

}  // namespace arah
