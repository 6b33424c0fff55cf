// EasyMocap's fits: JSON, or what NumPy pickled where that begins like it (host/capture/dataset.h).
#include "host/capture/dataset.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file(size > 0 && data[0] == 0x93 ? "0.npy" : "0.json", data, size, [](const auto& path) { arah::read_body_fit(path); });
}
