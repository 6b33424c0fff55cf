// Settings of training and pre-training (host/training/training_settings.h, pretrain_settings.h).
#include "host/training/pretrain_settings.h"
#include "host/training/training_settings.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(arah::text_of(data, size));
  arah::expect_result_or_input_error([&] { arah::settings_from_json(text, "settings"); });
  arah::expect_result_or_input_error([&] { arah::pretrain_settings_from_json(text, "settings"); });
  return 0;
}
