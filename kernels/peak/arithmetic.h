// How fast the device multiplies and adds: a yardstick for the other kernels' GFLOP/s.
#pragma once

#include "kernels/vulkan/commands.h"

namespace arah {

struct ArithmeticPeakArgs {
  static constexpr uint32_t chains = 12, links_a_round = 8;
  static constexpr uint32_t most_rounds = 65534;  // lavapipe ends an invocation's loops after 65,535 rounds, silently

  uint32_t workgroups = 0;  // of 64 invocations
  uint32_t rounds = 0;      // at most most_rounds
  // With 1 and a whole number, as long as no chain passes 2^24, every result is exact: it counts the links.
  float factor = 1, term = 1;
  // out, float [64 · workgroups]: Σ_k a_k after links_a_round · rounds links a ← a · factor + term, where chain k of
  // invocation i begins at k + i mod 64
  BufferSlice sums;
};
// Counts a multiply-add as two operations. Throws std::invalid_argument for too many rounds.
void record_arithmetic_peak(Commands& commands, const ArithmeticPeakArgs& args);

}  // namespace arah
