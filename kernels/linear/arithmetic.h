// In which numbers a network that gives pictures computes (docs/decisions/arithmetic.md). Training knows float32 alone.
#pragma once

#include "kernels/linear/matrix.h"

namespace arah {

enum class Arithmetic {
  float32,
  half_storage,        // what only the next layer reads is stored as halves; products and sums are float32
  cooperative_matrix,  // likewise, and layers between halves multiply halves on the device's matrix units, with sums in float32
};
constexpr Element hidden_element(Arithmetic arithmetic) { return arithmetic == Arithmetic::float32 ? Element::float32 : Element::half; }

constexpr const char* to_string(Arithmetic arithmetic) {
  switch (arithmetic) {
    case Arithmetic::float32: return "float32";
    case Arithmetic::half_storage: return "half_storage";
    case Arithmetic::cooperative_matrix: return "cooperative_matrix";
  }
  return "";
}

}  // namespace arah
