// cameras.json (host/capture/camera.h).
#include "host/capture/camera.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("cameras.json", data, size, [](const auto& path) { arah::read_cameras(path); });
}
