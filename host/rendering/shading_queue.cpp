#include "host/rendering/shading_queue.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "kernels/compositing/fill_queue.h"
#include "kernels/tracing/compact.h"

namespace arah {

ShadingQueue::ShadingQueue(Device& device, uint32_t capacity) : device_(device), capacity_(padded_points(capacity)) {
  auto make = [&](const char* what, uint64_t bytes, BufferPlace place = BufferPlace::device) { return Buffer(device, std::string("shaded samples: ") + what, bytes, place); };
  flags_ = make("flags", capacity_ * 4ull);
  samples_ = make("rows", capacity_ * 4ull);
  slots_ = make("slots", capacity_ * 4ull);
  canonical_ = make("canonical points", capacity_ * 16ull);
  count_ = make("count", sizeof(WorkCount), BufferPlace::shared);
  scratch_ = make("compaction", compact_blocks(capacity_) * 4ull);
  device.upload(samples_.slice(), std::vector<uint32_t>(capacity_, 0));  // an empty queue names row 0
}

void ShadingQueue::select(Commands& commands, uint32_t rows, const BufferSlice& canonical) {
  if (rows > capacity_) throw std::invalid_argument(fmt::format("queue of shaded samples: {} samples in room for {}", rows, capacity_));
  CompactArgs flagged;
  flagged.rows.range.points = rows;
  flagged.flags = flags();
  flagged.scratch = scratch_.slice();
  flagged.compacted = samples();
  flagged.count = count_.slice();
  record_compact(commands, flagged);
  commands.submit_and_wait();
  WorkCount count{};
  device_.download(count_.slice(), &count, sizeof count);
  shaded_ = count.count;
  size_ = std::max(shaded_, 1u);
  FillQueueArgs fill;
  fill.count = shaded_;
  fill.rows = rows;
  fill.samples = samples();
  fill.canonical = canonical;
  fill.queued = this->canonical();
  fill.slots = slots();
  record_fill_queue(commands, fill);
}

}  // namespace arah
