// Thrown where whoever waits for a picture, or a part of it, said that it is no longer wanted.
#pragma once

#include <stdexcept>

namespace arah {

class RenderingStopped : public std::runtime_error {
 public:
  RenderingStopped() : std::runtime_error("stopped") {}
};

}  // namespace arah
