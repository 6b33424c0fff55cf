#include "kernels/reference/half.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace arah::reference {
namespace {

TEST(Half, EveryHalfIsItsOwnNearest) {
  for (uint32_t bits = 0; bits < 0x10000; ++bits) {
    const double value = half_value(static_cast<uint16_t>(bits));
    if (std::isnan(value)) continue;
    ASSERT_EQ(half_bits(value), bits);
    ASSERT_EQ(nearest_half(value), value) << bits;
  }
  EXPECT_EQ(half_value(0x3c00), 1.0);
  EXPECT_EQ(half_value(0xc000), -2.0);
  EXPECT_EQ(half_value(0x0001), std::ldexp(1.0, -24));
}

TEST(Half, RoundsToTheNearestAndTiesToEven) {
  const double step = std::ldexp(1.0, -10);  // from 1 to 2
  EXPECT_EQ(nearest_half(1 + 0.49 * step), 1.0);
  EXPECT_EQ(nearest_half(1 + 0.5 * step), 1.0);
  EXPECT_EQ(nearest_half(1 + 1.5 * step), 1 + 2 * step);
  EXPECT_EQ(nearest_half(-1 - 0.51 * step), -1 - step);
  EXPECT_EQ(nearest_half(std::ldexp(1.4, -24)), std::ldexp(1.0, -24));
  EXPECT_EQ(nearest_half(std::ldexp(0.5, -24)), 0.0);
}

TEST(Half, KeepsWhatIsNotFiniteAndStopsAtItsLargest) {
  EXPECT_EQ(nearest_half(65519), 65504.0);
  EXPECT_EQ(nearest_half(-1e9), -65504.0);
  EXPECT_TRUE(std::isinf(nearest_half(std::numeric_limits<double>::infinity())));
  EXPECT_TRUE(std::isnan(nearest_half(std::nan(""))));
}

}  // namespace
}  // namespace arah::reference
