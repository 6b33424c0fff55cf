// Layer norm and ReLU of one vector a block (reference::hyper_trunk_forward; ARAH.md section 1, "Hypernetwork").
#pragma once

#include "kernels/vulkan/commands.h"

namespace arah {

struct LayerNormArgs {
  uint32_t blocks = 0, size = 0;  // numbers of each block, normalised together
  BufferSlice a;                  // float [blocks][size], as all below but inverse_deviation
  BufferSlice scale, shift;
  BufferSlice normalised;         // out (=): (a − mean) / √(variance + 1e-5)
  BufferSlice inverse_deviation;  // out (=): float [blocks]
  BufferSlice y;                  // out (=): max(scale · normalised + shift, 0)
};
void record_layer_norm(Commands& commands, const LayerNormArgs& args);

struct LayerNormBackwardArgs {
  LayerNormArgs forward;
  BufferSlice d_y;
  BufferSlice d_scale, d_shift;  // +=
  BufferSlice d_a;               // out (=)
};
void record_layer_norm_backward(Commands& commands, const LayerNormBackwardArgs& args);

}  // namespace arah
