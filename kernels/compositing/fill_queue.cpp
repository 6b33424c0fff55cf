#include "kernels/compositing/fill_queue.h"

#include <algorithm>

#include "kernels/compositing/samples.h"

namespace arah {

void record_fill_queue(Commands& commands, const FillQueueArgs& args) {
  const uint64_t padded = padded_points(std::max(args.count, 1u));  // an empty queue has padding all the same
  commands.fill(args.slots.elements(0, args.rows), no_slot);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("compositing/fill_queue");
  launch.name = "queue of shaded samples";
  launch.groups = {static_cast<uint32_t>(padded / point_padding), 1, 1};
  launch.bindings = {{args.samples, padded * 4}, {args.canonical, args.rows * 16ull}, {args.queued, padded * 16}, {args.slots, args.rows * 4ull}};
  launch.push_constants = &args.count;
  launch.push_constant_bytes = sizeof args.count;
  launch.cost = {0, 40.0 * args.count};
  commands.dispatch(launch);
}

}  // namespace arah
