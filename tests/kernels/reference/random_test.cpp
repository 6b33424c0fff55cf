#include "kernels/reference/random.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <glm/glm.hpp>

// The shader library's text is also valid C++ over glm's types: the same lines are tested here.
namespace shader {
using glm::uint;
using glm::uvec4;
#include "shaders/lib/random.glsl"
}  // namespace shader

namespace arah::reference {
namespace {

TEST(Random, KnownAnswers) {
  // Computed with unbounded integers reduced modulo 2^32, independently of this code.
  using Bits = std::array<std::uint32_t, 4>;
  EXPECT_EQ(random_bits({0, 0, 0, 0}), (Bits{0x0f02f829, 0x2d568769, 0x32b0c43b, 0xd32548ea}));
  EXPECT_EQ(random_bits({1, 2, 3, 4}), (Bits{0x3622cd16, 0xf11471d8, 0xe1109b3f, 0x02b94c2f}));
  EXPECT_EQ(random_bits({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}),
            (Bits{0x974ed892, 0xc015dc67, 0x9f955760, 0xa1bba208}));
  EXPECT_EQ(random_unit(20220901, 7, 65535, 11), 0x45f617 / 16777216.0f);
}

TEST(Random, ShaderTextComputesTheSameNumbers) {
  for (std::uint32_t i = 0; i < 10000; ++i) {
    const std::uint32_t seed = i * 2654435761u, step = i % 97, ray = i * 7919u, dimension = i % 13;
    ASSERT_EQ(random_unit(seed, step, ray, dimension), shader::random_unit(seed, step, ray, dimension)) << i;
  }
}

// Along each of the four counters: mean, variance, correlation of neighbours and a 16-bin chi-square.
TEST(Random, UniformAndUncorrelatedAlongEveryCounter) {
  constexpr int kCount = 65536, kBins = 16;
  for (int counter = 0; counter < 4; ++counter) {
    double sum = 0, squares = 0, products = 0, previous = 0.5;
    std::array<int, kBins> histogram{};
    for (std::uint32_t i = 0; i < kCount; ++i) {
      std::array<std::uint32_t, 4> key{3, 5, 7, 11};
      key[counter] = i;
      const double u = random_unit(key[0], key[1], key[2], key[3]);
      ASSERT_GE(u, 0);
      ASSERT_LT(u, 1);
      sum += u - 0.5;
      squares += (u - 0.5) * (u - 0.5);
      products += (u - 0.5) * (previous - 0.5);
      previous = u;
      ++histogram[static_cast<int>(u * kBins)];
    }
    // Five standard deviations of each estimate for independent uniform numbers.
    EXPECT_NEAR(sum / kCount, 0, 5 * std::sqrt(1.0 / 12 / kCount)) << counter;
    EXPECT_NEAR(squares / kCount, 1.0 / 12, 5 * std::sqrt(1.0 / 180 / kCount)) << counter;
    EXPECT_NEAR(products / kCount, 0, 5 * (1.0 / 12) / std::sqrt(kCount)) << counter;
    double chi_square = 0;
    for (int count : histogram) chi_square += std::pow(count - kCount / kBins, 2) / (kCount / kBins);
    EXPECT_LT(chi_square, 15 + 5 * std::sqrt(30.0)) << counter;
  }
}

}  // namespace
}  // namespace arah::reference
