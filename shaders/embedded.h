// The SPIR-V of every shaders/<area>/<stem>.comp, embedded in the program at build time (cmake/Shaders.cmake).
#pragma once

namespace arah {

struct EmbeddedShader {
  const char* name;            // "<area>/<stem>"; nullptr ends the table
  const unsigned char* begin;  // SPIR-V words, 4-byte aligned
  const unsigned char* end;
};

const EmbeddedShader* embedded_shaders();

// The Vulkan extension that linear/cooperative_forward is built for; "" where it was left out.
const char* cooperative_matrix_extension();

}  // namespace arah
