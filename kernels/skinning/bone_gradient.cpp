#include "kernels/skinning/bone_gradient.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/reduction/sum.h"
#include "shaders/shared/skinning.h"

namespace arah {

uint64_t bone_gradient_partials(uint32_t rows, uint32_t joints) { return partial_bytes(rows, 12 * joints); }

void record_bone_gradient(Commands& commands, const BoneGradientArgs& args) {
  const uint32_t rows = args.rows.range.points, chunks = padded_points(rows) / point_padding;
  const bool by_vertex = args.weights.empty();
  if (args.joints == 0 || args.joints > 64) throw std::invalid_argument(fmt::format("bone gradient: {} joints, expected 1 to 64", args.joints));
  if (!by_vertex) check_channels("bone gradient: weights", args.weights, args.joints);
  if (rows == 0) return;

  std::vector<uint32_t> specialization = rows_specialization(args.rows);
  specialization.push_back(args.joints);
  specialization.push_back(by_vertex);
  const shared::BoneGradientConstants constants{rows, args.weights.stride / 4, args.weights.column / 4};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("skinning/bone_gradient", specialization);
  launch.name = "gradient of bone transforms";
  launch.bindings = {{args.cotangents, vec4_bytes(rows)},
                     {args.canonical, vec4_bytes(rows)},
                     by_vertex ? Binding{args.target.weights} : matrix_binding(args.weights, rows),
                     by_vertex ? Binding{args.nearest} : Binding{args.cotangents},
                     by_vertex ? Binding{args.target.joints} : Binding{args.cotangents},
                     {args.partials, bone_gradient_partials(rows, args.joints)}};
  add_rows(launch, args.rows, args.cotangents);
  launch.groups = {(3 * args.joints + 63) / 64, chunks, 1};  // rows are a loop's here
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * args.joints * 27.0, rows * (32.0 + (by_vertex ? 24.0 : 4.0 * args.joints))};
  commands.dispatch(launch);

  SumArgs sum;
  sum.name = "gradient of bone transforms, sum";
  sum.rows = chunks;
  sum.columns = 12 * args.joints;
  sum.partials = args.partials;
  sum.sums = args.gradients;
  record_sum(commands, sum);
}

}  // namespace arah
