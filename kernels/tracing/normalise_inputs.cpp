#include "kernels/tracing/normalise_inputs.h"

#include "shaders/shared/frame.h"
#include "shaders/shared/tracing.h"

namespace arah {

void record_normalise_inputs(Commands& commands, const NormaliseInputsArgs& args) {
  const uint32_t rows = args.rows.range.points;
  check_channels("normalised inputs", args.inputs, 3);
  const shared::NormaliseInputsConstants constants{rows, args.inputs.stride / 8, args.inputs.column / 8};
  std::vector<uint32_t> words = rows_specialization(args.rows);
  words.push_back(args.from_root);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("tracing/normalise_inputs", words);
  launch.name = "normalise inputs";
  launch.bindings = {{args.frame, sizeof(FrameConstants)}, args.canonical, matrix_binding(args.inputs, rows)};
  add_rows(launch, args.rows, args.frame);
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {rows * 6.0, rows * 48.0};
  commands.dispatch(launch);
}

}  // namespace arah
