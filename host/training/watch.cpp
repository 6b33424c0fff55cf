#include "host/training/watch.h"

#include <array>
#include <cstddef>
#include <cstring>

namespace arah {
namespace {

constexpr uint64_t record_stride = 256;  // bytes: any device binds at multiples of it
constexpr auto watched_count = static_cast<uint64_t>(Watched::count);

}  // namespace

const WatchedTensor& description(Watched what) {
  // Weights and colours are at most 1, their sums along a ray a little more by rounding.
  static constexpr std::array<WatchedTensor, watched_count> tensors{{
      {"correspondence search", "canonical points", WatchedRow::sample, 3, 1e6},
      {"distances", "signed distances", WatchedRow::sample, 1, 1e6},
      {"shading", "SDF gradients", WatchedRow::sample, 3, 1e6},
      {"shading", "colours", WatchedRow::sample, 3, 1.01},
      {"compositing", "weights", WatchedRow::sample, 1, 1.01},
      {"compositing", "rays' colours", WatchedRow::ray, 4, 1.01},
      {"regularisers", "SDF gradients at eikonal points", WatchedRow::point, 3, 1e6},
      {"regularisers", "signed distances inside and outside", WatchedRow::point, 1, 1e6},
      {"losses", "gradients of rays' colours", WatchedRow::ray, 4, 0},
      {"compositing backward", "gradients of distances", WatchedRow::sample, 1, 0},
      {"compositing backward", "gradients of colours", WatchedRow::sample, 3, 0},
      {"shading backward", "gradients of canonical points", WatchedRow::sample, 3, 0},
  }};
  return tensors.at(static_cast<size_t>(what));
}

Watch::Watch(Device& device) : device_(device), records_(device, "training: what the watch saw", watched_count * record_stride, BufferPlace::shared) {}

void Watch::record_clear(Commands& commands) { commands.fill(records_.slice(), 0); }

void Watch::record(Commands& commands, Watched what, const Part& part) {
  const WatchedTensor& tensor = description(what);
  WatchArgs args;
  args.name = tensor.tensor;
  args.values = part.values;
  args.rows = part.rows;
  args.channels = tensor.channels;
  if (tensor.limit > 0) args.limit = static_cast<float>(tensor.limit);
  args.points = part.points;
  args.row_ids = part.row_ids;
  args.first_row = part.first_row;
  args.record = records_.slice().sub(static_cast<uint64_t>(what) * record_stride, sizeof(shared::WatchRecord));
  args.after_previous = part.after_previous;
  if (part.rows > 0) record_watch(commands, args);
}

std::vector<Watch::Seen> Watch::seen() {
  const auto bytes = device_.download<std::byte>(records_.slice());
  std::vector<Seen> result;
  for (uint64_t i = 0; i < watched_count; ++i) {
    Seen seen{static_cast<Watched>(i), {}};
    std::memcpy(&seen.record, bytes.data() + i * record_stride, sizeof seen.record);
    if (seen.record.first_inverted) result.push_back(seen);
  }
  return result;
}

}  // namespace arah
