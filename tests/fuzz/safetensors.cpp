// Named tensors, their numbers too (host/avatar/safetensors.h).
#include "host/avatar/safetensors.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("a.safetensors", data, size, [](const auto& path) {
    for (const auto& entry : arah::read_safetensors(path).tensors) {
      entry.second.template as<double>();
      arah::expect_result_or_input_error([&] { entry.second.template as<std::uint8_t>(); });  // of fractions, or above 255
    }
  });
}
