// GLSL's types by their own names in C++, with scalar block layout: what lets one struct serve both languages.
// Included by the C++ branch of the headers beside it only.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace arah::shared {

using uint = uint32_t;
using vec3 = std::array<float, 3>;
using vec4 = std::array<float, 4>;
using uvec2 = std::array<uint, 2>;
using uvec3 = std::array<uint, 3>;

static_assert(sizeof(vec3) == 12 && alignof(vec3) == 4);

}  // namespace arah::shared
