// Second level of a gradient's norm: the norm itself and the factor that clips it, on the device.
#pragma once

#include "kernels/vulkan/commands.h"
#include "shaders/shared/optimizer.h"

namespace arah {

struct ClipScaleArgs {
  uint32_t partials_count = 0;  // at most 4 million
  BufferSlice partials;         // shared::SquaresPartial (record_sum_of_squares)
  float max_norm = 0;           // 0: no limit
  // out (=): element norm_index of shared::GradientNorm: norm, min(1, max_norm / norm), how many numbers are NaN or
  // infinite (training stops on them), and whether the group may be stepped.
  BufferSlice norms;
  uint32_t norm_index = 0;
};

void record_clip_scale(Commands& commands, const ClipScaleArgs& args);

}  // namespace arah
