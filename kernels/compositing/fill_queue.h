// The queue of the samples that are shaded, from the list that compaction leaves (kernels/tracing/compact.h).
#pragma once

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

struct FillQueueArgs {
  uint32_t count = 0;     // samples in the queue, known to the host
  uint32_t rows = 0;      // samples in all
  BufferSlice samples;    // uint32 [padded_points(count)]: the row of each slot's sample
  BufferSlice canonical;  // vec4 by row
  BufferSlice queued;     // out, vec4 by slot: its canonical point; w = 0 in the padding, 64 slots of it where count is 0
  BufferSlice slots;      // out, uint32 by row: its slot; no_slot (kernels/compositing/samples.h) where it is not queued
};
void record_fill_queue(Commands& commands, const FillQueueArgs& args);

}  // namespace arah
