// The yardsticks must do the work that they are timed for: a result says how many links a chain had and what was read.
#include <cmath>
#include <stdexcept>

#include "kernels/peak/arithmetic.h"
#include "kernels/peak/bandwidth.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

class Peak : public DeviceTest {};

TEST_F(Peak, ArithmeticCountsItsLinks) {
  Buffer sums = empty("sums", 3 * 64 * 4);
  for (const uint32_t rounds : {0u, 1u, 1000u, ArithmeticPeakArgs::most_rounds}) {
    record_arithmetic_peak(commands, {3, rounds, 1, 1, sums.slice()});
    commands.submit_and_wait();
    const std::vector<float> found = device.download<float>(sums.slice());
    for (uint32_t i = 0; i < 192; ++i) {
      // Σ_k (k + i mod 64 + links), below 2^24: exact.
      ASSERT_EQ(found[i], 66.0 + 12.0 * (i % 64 + 8.0 * rounds)) << rounds << " rounds, invocation " << i;
    }
  }
}

TEST_F(Peak, ArithmeticMultipliesAndAdds) {
  Buffer sums = empty("sums", 64 * 4);
  for (const auto& [factor, term] : {std::pair{0.5f, 0.25f}, {-0.97f, 3.0f}}) {
    record_arithmetic_peak(commands, {1, 5, factor, term, sums.slice()});
    commands.submit_and_wait();
    const std::vector<float> found = device.download<float>(sums.slice());
    for (uint32_t i = 0; i < 64; ++i) {
      double expected = 0;
      for (uint32_t k = 0; k < 12; ++k) {
        double a = k + i;
        for (int link = 0; link < 40; ++link) a = a * double(factor) + double(term);
        expected += a;
      }
      // Forty links each round twice; a number is at most 75.
      ASSERT_NEAR(found[i], expected, 12 * 2 * 40 * 75 * 0x1p-24) << factor << ", invocation " << i;
    }
  }
  EXPECT_THROW(record_arithmetic_peak(commands, {1, ArithmeticPeakArgs::most_rounds + 1, 1, 1, sums.slice()}), std::invalid_argument);
}

TEST_F(Peak, BandwidthReadsEveryRowOnce) {
  for (const uint32_t reads : {1u, 3u, 16u}) {
    constexpr uint32_t groups = 3;
    std::vector<float> values(size_t(64) * groups * reads * 8);
    for (size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i);  // their sums are exact
    Buffer rows = filled("rows", values), sums = empty("sums", 64 * groups * 32);
    record_bandwidth_peak(commands, {groups, reads, rows.slice(), sums.slice()});
    commands.submit_and_wait();
    const std::vector<float> found = device.download<float>(sums.slice());
    for (size_t g = 0; g < 8 * groups; ++g)
      for (size_t i = 0; i < 8; ++i)
        for (size_t c = 0; c < 8; ++c) {
          double expected = 0;
          for (size_t r = 0; r < reads; ++r) expected += double(values[(8 * (g * reads + r) + i) * 8 + c]);
          ASSERT_EQ(found[(8 * g + i) * 8 + c], expected) << reads << " reads, row " << 8 * g + i << ", column " << c;
        }
  }
  Buffer any = empty("rows", 64 * 32);
  EXPECT_THROW(record_bandwidth_peak(commands, {1, 0, any.slice(), any.slice()}), std::invalid_argument);
  EXPECT_THROW(record_bandwidth_peak(commands, {1, 65, any.slice(), any.slice()}), std::invalid_argument);
}

}  // namespace
}  // namespace arah
