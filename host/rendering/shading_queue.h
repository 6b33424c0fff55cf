// Which samples are worth shading: those whose compositing weight exceeds a threshold, as a queue without gaps. The weight
// follows from the signed distances alone, so colours, normals and their gradients are computed for the queue's samples only.
#pragma once

#include "kernels/tracing/rows.h"
#include "shaders/shared/work_count.h"

namespace arah {

class ShadingQueue {
 public:
  // capacity: samples at a time.
  ShadingQueue(Device& device, uint32_t capacity);

  BufferSlice flags() { return flags_.slice(); }  // uint32 by row: 1 where the sample is to be shaded; the caller writes it

  // The flagged rows in order. Submits, to know how many there are, and leaves the last launches recorded.
  // canonical: vec4 by row. Where no row is flagged the queue holds one slot that belongs to no row.
  void select(Commands& commands, uint32_t rows, const BufferSlice& canonical);

  uint32_t size() const { return size_; }          // slots, at least 1
  uint32_t shaded() const { return shaded_; }      // of them with a sample
  BufferSlice samples() { return samples_.slice(); }    // uint32 by slot: the row of its sample
  BufferSlice slots() { return slots_.slice(); }        // uint32 by row: its slot, or no_slot
  BufferSlice canonical() { return canonical_.slice(); }  // vec4 by slot; padding slots have w = 0

 private:
  Device& device_;
  uint32_t capacity_, size_ = 1, shaded_ = 0;
  Buffer flags_, samples_, slots_, canonical_, count_, scratch_;
};

}  // namespace arah
