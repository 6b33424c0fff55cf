// ONNX networks, read and written anew for OpenCV (host/evaluation/onnx_model.h).
#include "host/evaluation/onnx_model.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    arah::describe(arah::onnx_signature(arah::text_of(data, size)).inputs);
    arah::for_opencv(arah::text_of(data, size), {1, 3, 64, 80});
  } catch (const arah::NotOnnx&) {
  }
  return 0;
}
