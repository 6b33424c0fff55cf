// The program's version, as avatar files and `arah --version` state it. Equal to the version of CMake's project().
#pragma once

namespace arah {

inline constexpr const char* kVersion = "0.1.0";

}  // namespace arah
