// Sizes of flat arrays, checked at the door of every reference function.
#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>

namespace arah::reference {

// Throws std::invalid_argument "<what>: expected <expected> numbers, found <found>" when the two differ.
inline void check_size(const char* what, std::size_t found, std::size_t expected) {
  if (found != expected) {
    throw std::invalid_argument(std::string(what) + ": expected " + std::to_string(expected) + " numbers, found " +
                                std::to_string(found));
  }
}

}  // namespace arah::reference
