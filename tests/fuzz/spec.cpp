// The part of an avatar that says what is modelled (host/avatar/avatar_spec.h).
#include "host/avatar/avatar_spec.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(arah::text_of(data, size));
  arah::expect_result_or_input_error([&] { arah::spec_from_json(text, "spec"); });
  arah::expect_result_or_input_error([&] { arah::spec_with_json(arah::AvatarSpec{}, text, "spec"); });
  return 0;
}
