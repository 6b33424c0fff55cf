// Pictures, PNG and JPEG (host/capture/picture_file.h). OpenCV and its codecs are the system's, without instrumentation.
#include "host/capture/picture_file.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("a.png", data, size, [](const auto& path) { arah::read_picture_file(path); });
}
