#include "kernels/tracing/rows.h"

#include <fmt/format.h>

#include <stdexcept>

#include "shaders/shared/work_count.h"

namespace arah {

void add_rows(Launch& launch, const Rows& rows, const BufferSlice& unused) {
  const PointRange& range = rows.range;
  launch.bindings.insert(launch.bindings.begin(),
                         {rows.ids.empty() ? Binding{unused} : Binding{rows.ids, uint_bytes(range.points)},
                          range.indirect.empty() ? Binding{unused} : Binding{range.indirect, sizeof(WorkCount)}});
  set_range(launch, range);
}

std::vector<uint32_t> rows_specialization(const Rows& rows) {
  return {rows.ids.empty() ? 0u : 1u, rows.range.indirect.empty() ? 0u : 1u};
}

void check_channels(const char* what, const Matrix& matrix, uint32_t channels) {
  if (matrix.column % channel_padding != 0 || matrix.stride % channel_padding != 0 ||
      matrix.column + padded_channels(channels) > matrix.stride)
    throw std::invalid_argument(fmt::format("{}: stride {} and column {} leave no room for {} channels", what,
                                            matrix.stride, matrix.column, channels));
}

}  // namespace arah
