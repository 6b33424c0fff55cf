// Views that a viewer saved (viewer/view_state.h). What was read can be written and read again.
#include "viewer/view_state.h"

#include <optional>

#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::optional<arah::ViewState> state;
  arah::expect_result_or_input_error([&] { state = arah::view_state_from_json(arah::text_of(data, size), "view.json"); });
  if (state && arah::view_state_from_json(arah::view_state_json(*state), "view.json") != *state) std::abort();
  return 0;
}
