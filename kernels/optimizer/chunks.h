// A range of the flat parameter buffers is longer than what a device binds at once (128 MB at least): it runs in
// chunks.
#pragma once

#include <cstdint>

namespace arah {

inline constexpr uint64_t optimizer_chunk = uint64_t(1) << 24;  // floats: 64 MB, and 32,768 workgroups of Adam

// Floats of a range of `bytes`. Throws std::invalid_argument, naming `kernel`, unless they are a multiple of 64.
uint64_t range_floats(const char* kernel, uint64_t bytes);

}  // namespace arah
