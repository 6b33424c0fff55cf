#include "kernels/compositing/group_samples.h"

#include <algorithm>

#include "kernels/linear/matrix.h"
#include "shaders/shared/compositing.h"

namespace arah {

void record_group_samples(Commands& commands, const GroupSamplesArgs& args) {
  const shared::GroupSamplesConstants constants{args.rays, args.samples, std::max(args.groups, 1u), args.least_weight, args.near};
  const uint64_t rows = uint64_t(args.rays) * args.samples;
  Launch launch;
  launch.pipeline = &commands.device().pipeline("compositing/group_samples");
  launch.name = "shaded samples: groups";
  launch.groups = {padded_points(args.rays) / point_padding, 1, 1};
  launch.bindings = {{args.weights, rows * 4}, {args.points, rows * 16}, {args.flags, rows * 4}, {args.points, rows * 16}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {static_cast<double>(rows) * 24, static_cast<double>(rows) * 28};
  commands.dispatch(launch);
}

}  // namespace arah
