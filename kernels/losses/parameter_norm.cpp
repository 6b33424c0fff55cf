#include "kernels/losses/parameter_norm.h"

#include "kernels/linear/matrix.h"
#include "kernels/optimizer/clip_scale.h"
#include "kernels/optimizer/sum_of_squares.h"
#include "shaders/shared/losses.h"

namespace arah {

void record_parameter_norm(Commands& commands, const ParameterNormArgs& args) {
  uint32_t partials = 0;
  uint64_t numbers = 0;
  for (const ParameterNormArgs::Part& part : args.parts) {
    record_sum_of_squares(commands, {part.phi, args.partials, partials});
    partials += squares_partials(part.phi.bytes / 4);
    numbers += part.numbers;
  }
  record_clip_scale(commands, {partials, args.partials, 0, args.norm, 0});
  shared::ParameterNormConstants constants{0, 1.0f / static_cast<float>(numbers), args.weight, 1, args.slot};
  for (const ParameterNormArgs::Part& part : args.parts) {
    constants.numbers = static_cast<uint32_t>(part.numbers);
    Launch launch;
    launch.pipeline = &commands.device().pipeline("losses/parameter_norm");
    launch.name = "loss on the size of the generated parameters";
    launch.groups = {static_cast<uint32_t>((part.numbers + point_padding - 1) / point_padding), 1, 1};
    launch.bindings = {{args.norm, sizeof(shared::GradientNorm)}, {part.phi, part.numbers * 4}, {part.d_phi, part.numbers * 4}, {args.losses, (args.slot + 1) * 4ull}};
    launch.push_constants = &constants;
    launch.push_constant_bytes = sizeof constants;
    launch.after_previous = constants.first != 0;
    launch.cost = {3.0 * double(part.numbers), 12.0 * double(part.numbers)};
    commands.dispatch(launch);
    constants.first = 0;
  }
}

}  // namespace arah
