#include "host/rendering/root_rescue.h"

#include <algorithm>

#include "kernels/tracing/compact.h"
#include "kernels/tracing/damped_newton.h"
#include "kernels/tracing/several_starts.h"
#include "shaders/shared/work_count.h"

namespace arah {
namespace {

constexpr uint32_t rows_at_a_time = 2048;  // some per cent of a batch of samples have no root
constexpr uint32_t look_every = 4;         // steps between the host's questions whether any search goes on

}  // namespace

RootRescue::RootRescue(Device& device, AvatarNetworks& networks, uint32_t capacity) : device_(device), networks_(networks), skinning_(device, networks, rows_at_a_time, "root rescue") {
  const auto make = [&](const char* what, uint64_t bytes, BufferPlace place = BufferPlace::device) { return Buffer(device, std::string("root rescue: ") + what, bytes, place); };
  unsolved_ = make("flags", capacity * 4ull);
  ids_ = make("points without a root", (capacity + rows_at_a_time) * 4ull);
  count_ = make("their number", sizeof(WorkCount), BufferPlace::shared);
  scratch_ = make("compaction", compact_blocks(capacity) * 4ull);
  starts_ = make("starts", capacity * 16ull);
  bone_segments_ = make("bones", networks.bone_segments().size() * 16ull);
  device.upload(bone_segments_.slice(), networks.bone_segments());
  state_ = make("state", rows_at_a_time * damped_newton_state_bytes);
  trials_ = make("trials", rows_at_a_time * 16ull);
  search_counts_ = make("counts", sizeof(DampedNewtonCounts), BufferPlace::shared);
}

void RootRescue::solve(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical, uint32_t steps, uint32_t bone_starts, float tolerance) {
  record_mark_unsolved(commands, {points, targets, canonical, unsolved_.slice()});
  CompactArgs listing;
  listing.rows.range.points = points;
  listing.flags = unsolved_.slice();
  listing.scratch = scratch_.slice();
  listing.compacted = ids_.slice();
  listing.count = count_.slice();
  record_compact(commands, listing);
  commands.fill(search_counts_.slice(), 0);
  commands.submit_and_wait();
  WorkCount unsolved{};
  device_.download(count_.slice(), &unsolved, sizeof unsolved);
  counts.searched += unsolved.count;

  for (uint32_t first = 0; first < unsolved.count; first += rows_at_a_time) {
    const uint32_t count = std::min(rows_at_a_time, unsolved.count - first);
    const Rows rows{{count, {}}, ids_.slice().elements(first, padded_points(count))}, by_row{{count, {}}, {}};
    uint64_t left = count;
    for (uint32_t start = 0; start <= bone_starts && left > 0; ++start) {
      if (start > 0) record_bone_starts(commands, {rows, frame.constants(), targets, bone_segments_.slice(), static_cast<uint32_t>(networks_.bone_segments().size() / 2), start - 1, starts_.slice()});
      const DampedNewtonArgs newton{rows, state_.slice(), trials_.slice(), start == 0 ? canonical : starts_.slice(), skinning_.posed(), skinning_.jacobians(), targets, canonical, search_counts_.slice(), tolerance};
      record_damped_newton_start(commands, newton);
      for (uint32_t step = 0; step <= steps;) {
        for (const uint32_t end = std::min(step + look_every, steps + 1); step < end; ++step) {
          commands.fill(search_counts_.slice().sub(offsetof(DampedNewtonCounts, searching), 4), 0);
          skinning_.record(commands, frame, by_row, trials_.slice(), true);
          record_damped_newton(commands, newton);
        }
        commands.submit_and_wait();
        DampedNewtonCounts found{};
        device_.download(search_counts_.slice(), &found, sizeof found);
        commands.fill(search_counts_.slice(), 0);
        counts.evaluations += found.evaluations;
        (start == 0 ? counts.newton : counts.restarted) += found.found;
        left -= found.found;
        if (found.searching == 0) break;
      }
    }
  }
}

}  // namespace arah
