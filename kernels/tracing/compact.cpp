#include "kernels/tracing/compact.h"

#include <fmt/format.h>

#include <stdexcept>

#include "shaders/shared/tracing.h"
#include "shaders/shared/work_count.h"

namespace arah {

void record_compact(Commands& commands, const CompactArgs& args) {
  const uint32_t rows = args.rows.range.points, blocks = compact_blocks(rows);
  const bool in_w = args.flags.empty();
  if (rows > compact_most_rows)
    throw std::invalid_argument(fmt::format("compaction of {} rows; at most {} are possible", rows, compact_most_rows));

  std::vector<uint32_t> specialization = rows_specialization(args.rows);
  specialization.push_back(in_w);
  const Binding flags = in_w ? Binding{args.flagged_points} : Binding{args.flags, uint_bytes(rows)};
  const Binding points = in_w ? Binding{args.flagged_points, vec4_bytes(rows)} : Binding{args.flags};
  const shared::CompactConstants constants{rows};

  Launch launch;
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {0, rows * (in_w ? 16.0 : 4.0)};
  launch.pipeline = &commands.device().pipeline("tracing/count_flags", specialization);
  launch.name = "compaction, count";
  launch.bindings = {flags, points, {args.scratch, blocks * 4ull}};
  add_rows(launch, args.rows, args.scratch);
  launch.groups = {blocks, 1, 1};
  launch.indirect = {};
  commands.dispatch(launch);

  launch.pipeline = &commands.device().pipeline("tracing/compact", specialization);
  launch.name = "compaction";
  launch.bindings = {flags,
                     points,
                     {args.scratch, blocks * 4ull},
                     {args.compacted, uint_bytes(rows)},
                     {args.count, sizeof(WorkCount)}};
  add_rows(launch, args.rows, args.scratch);
  launch.groups = {blocks, 1, 1};
  launch.indirect = {};
  commands.dispatch(launch);
}

}  // namespace arah
