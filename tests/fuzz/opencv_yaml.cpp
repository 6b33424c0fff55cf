// Calibrations as OpenCV writes them (host/capture/opencv_yaml.h).
#include "host/capture/opencv_yaml.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("a.yml", data, size, [](const auto& path) { arah::OpenCvYaml{path}; });
}
