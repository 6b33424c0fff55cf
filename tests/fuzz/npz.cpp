// Archives of NumPy's arrays, each of them read (host/body/npz.h).
#include "host/body/npz.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("a.npz", data, size, [](const auto& path) {
    const arah::NpzFile file(path);
    for (const std::string& name : file.names()) arah::expect_result_or_input_error([&] { file.read(name); });
  });
}
