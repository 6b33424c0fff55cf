// Avatars (host/avatar/avatar_file.h).
#include "host/avatar/avatar_file.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("a.safetensors", data, size, [](const auto& path) { arah::check_finite(arah::load_avatar(path)); });
}
