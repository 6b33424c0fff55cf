// Smooth motions for a synthetic capture: a training motion and a different one that is held out.
#pragma once

#include <cstdint>

#include "host/body/pose.h"
#include "host/capture/synthetic_figure.h"

namespace arah {

enum class SyntheticSplit { kTrain, kNovel };

// The figure's pose at a time of the motion, which lasts kSyntheticMotionSeconds and repeats smoothly; any finite
// `seconds` is valid. World +Z up, the figure faces -Y at rest and its lowest point stands on z = 0.
//   kTrain  stepping on the spot, arms between hanging and level, elbows, twisting and leaning trunk, turning to and
//   fro kNovel  deep knee bends with raised and crossing arms, side leaning
// Rigs with SMPL's names move like that; others swing every joint gently about an axis of its own. The seed shifts the
// phases.
Pose synthetic_pose(const ClothedFigure& figure, SyntheticSplit split, double seconds, std::uint64_t seed);

inline constexpr double kSyntheticMotionSeconds = 6.0;

}  // namespace arah
