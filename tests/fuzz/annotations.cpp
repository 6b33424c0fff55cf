// annots.npy of ZJU-MoCap and Human3.6M (host/capture/dataset.h).
#include "host/capture/dataset.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("annots.npy", data, size, [](const auto& path) {
    for (const char* folder : {"mask", "params"}) std::filesystem::create_directory(path.parent_path() / folder);
    arah::read_h36m(path.parent_path());
  });
}
