// motion_<split>.json (host/body/motion.h).
#include "host/body/motion.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("motion.json", data, size, [](const auto& path) { arah::read_motion(path); });
}
