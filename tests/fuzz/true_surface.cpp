// The true surfaces of a capture, PLY (host/evaluation/true_surface.h).
#include "host/evaluation/true_surface.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("a.ply", data, size, [](const auto& path) { arah::read_true_surface(path); });
}
