// Counter-based random numbers: a pure function of (seed, step, ray, dimension), so that the order of execution is
// irrelevant and a resumed run repeats. Exactly the integers of shaders/lib/random.glsl.
// Source: pcg4d of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
#pragma once

#include <array>
#include <cstdint>

namespace arah::reference {

// 4 x 32 random bits of a 4 x 32 bit key; all arithmetic modulo 2^32.
constexpr std::array<std::uint32_t, 4> random_bits(std::array<std::uint32_t, 4> key) {
  for (std::uint32_t& word : key) word = word * 1664525u + 1013904223u;
  const auto mix = [&key] {
    key[0] += key[1] * key[3];
    key[1] += key[2] * key[0];
    key[2] += key[0] * key[1];
    key[3] += key[1] * key[2];
  };
  mix();
  for (std::uint32_t& word : key) word ^= word >> 16;
  mix();
  return key;
}

// Uniform in [0, 1): the 24 high bits of the first word times 2^-24, exact in float32.
constexpr float random_unit(std::uint32_t seed, std::uint32_t step, std::uint32_t ray, std::uint32_t dimension) {
  return static_cast<float>(random_bits({seed, step, ray, dimension})[0] >> 8) * 0x1p-24f;
}

}  // namespace arah::reference
