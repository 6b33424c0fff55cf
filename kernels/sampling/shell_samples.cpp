#include "kernels/sampling/shell_samples.h"

#include "kernels/linear/matrix.h"
#include "shaders/shared/sampling.h"

namespace arah {

void record_shell_samples(Commands& commands, const ShellSamplesArgs& args) {
  const uint32_t rows = args.rays * args.samples, padded = padded_points(rows);
  const shared::ShellSamplesConstants constants{args.root_translation,    args.rays,        args.samples,
                                                args.jitter.on ? 1u : 0u, args.jitter.seed, args.jitter.step,
                                                args.jitter.first_ray};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("sampling/shell_samples");
  launch.name = "samples in the shell";
  launch.groups = {padded / point_padding, 1, 1};
  launch.bindings = {{args.ray_list, uint64_t(args.rays) * 32},
                     {args.kept, uint64_t(args.rays) * 8},
                     {args.depths, uint64_t(padded) * 4},
                     {args.deltas, uint64_t(padded) * 4},
                     {args.points, uint64_t(padded) * 16}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * 90.0, rows * 64.0};
  commands.dispatch(launch);
}

}  // namespace arah
