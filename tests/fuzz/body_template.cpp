// Skinned bodies in glTF, binary or text (host/body/body_template.h).
#include "host/body/body_template.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file("a.glb", data, size, [](const auto& path) { arah::read_body_template(path); });
}
