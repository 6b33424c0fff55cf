#include "kernels/optimizer/outer_product.h"

namespace arah {

void record_outer_norm(Commands& commands, const OuterProduct& gradient, const BufferSlice& partials, uint32_t first_partial) {
  const shared::OuterNormConstants constants{(gradient.rows + 3) / 4, gradient.row_stride / 4, gradient.columns / 4, gradient.first_column / 4, gradient.column_stride / 4, first_partial};
  const uint32_t groups = outer_partials(gradient.pairs);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("optimizer/outer_norm");
  launch.name = "gradient norm of an outer product";
  launch.groups = {groups, 1, 1};
  launch.bindings = {gradient.a, gradient.b, {partials, (uint64_t(first_partial) + groups) * sizeof(shared::SquaresPartial)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {2.0 * groups * (gradient.rows + gradient.columns), 8.0 * groups * (gradient.rows + gradient.columns)};
  commands.dispatch(launch);
}

}  // namespace arah
