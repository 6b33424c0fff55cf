// Whether tests are to take their long form: ./run test --long.
#pragma once

#include <cstdlib>
#include <string>

namespace arah {

inline bool long_form() {
  const char* wanted = std::getenv("ARAH_LONG");
  return wanted && std::string(wanted) == "1";
}

}  // namespace arah
