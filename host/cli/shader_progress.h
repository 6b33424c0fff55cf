// The driver's compiling on the terminal: a first start takes seconds to tens of seconds of it, later ones read its cache.
#pragma once

#include <chrono>
#include <cstdio>

#include "kernels/vulkan/device.h"

namespace arah {

// "compiling shaders: 23 of 41, 6 s", once compiling has taken half a second: on a terminal a line that goes away, elsewhere a
// line at first and then every ten seconds. 41 are those asked for so far: the next batch of work may need more.
class ShaderLine {
 public:
  explicit ShaderLine(std::FILE* stream = stderr);  // not owned
  void show(const ShaderProgress& progress);

 private:
  std::FILE* stream_;
  bool terminal_, said_ = false;
  std::chrono::steady_clock::time_point last_;
};

// "41 shaders in 6.1 s".
std::string shaders_text(const Device& device);

}  // namespace arah
