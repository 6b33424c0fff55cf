// Bodies of the SMPL family, an archive or a pickle by the first letter (host/body/smpl_file.h).
#include "host/body/smpl_file.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return arah::fuzz_file(size > 0 && data[0] == 'P' ? "a.npz" : "a.pkl", data, size, [](const auto& path) { arah::read_smpl_body(path); });
}
