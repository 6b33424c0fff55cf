// NumPy's arrays, their numbers too (host/body/npy.h).
#include "host/body/npy.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  arah::expect_result_or_input_error([&] {
    const arah::PythonData value = arah::parse_npy(arah::text_of(data, size), "a.npy");
    arah::python_numbers(*value.root, -1, "a.npy", "");
  });
  return 0;
}
