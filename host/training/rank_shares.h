// Shares of ranks whose devices are not of one kind: by measured speed, so that the fast ones do not wait for the slow ones.
#pragma once

#include <vector>

#include "host/training/trainer.h"

namespace arah {

// Collective. Each rank takes three steps alone, at the same time as the others, with as many rays as its even part would be; the
// last two count. By rank: rays a second, the fastest one's 16, none less than 1. (What shares follow from a measurement may be other
// ones next time; the run's events tell them, for --shares.)
std::vector<uint32_t> shares_by_speed(Device& device, const Capture& capture, const Avatar& avatar, const TrainingSettings& settings, const Ranks& ranks);

}  // namespace arah
