// Motion capture in BVH files (host/body/motion_file.h).
#include "host/body/motion_file.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("a.bvh", data, size, [](const auto& path) { arah::read_motion_file(path); });
}
