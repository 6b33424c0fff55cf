// Pickled values (host/body/pickle.h).
#include "host/body/pickle.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  arah::expect_result_or_input_error([&] { arah::parse_pickle(arah::text_of(data, size), "a.pkl"); });
  return 0;
}
