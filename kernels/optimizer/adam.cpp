#include "kernels/optimizer/adam.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "kernels/linear/matrix.h"
#include "kernels/optimizer/chunks.h"

namespace arah {

void record_adam(Commands& commands, const AdamArgs& args) {
  if (args.step == 0) throw std::invalid_argument("adam: step 0; steps are counted from 1");
  const uint64_t count = range_floats("adam", args.parameters.bytes);
  const bool averaged = !args.averages.empty(), limited = !args.norms.empty();
  const bool on_cpu = commands.device().report().type == DeviceType::cpu;
  const OuterProduct& outer = args.outer;
  const uint64_t outer_numbers = uint64_t(outer.rows) * outer.columns;
  if (outer.pairs && (outer.columns % 8 || outer.row_stride % 4 || outer.column_stride % 4 || args.lazy || outer_numbers > count || count - outer_numbers >= 64))
    throw std::invalid_argument(fmt::format("adam: an outer product of {} x {} for {} numbers; columns a multiple of 8, strides of 4, and the same size expected", outer.rows, outer.columns, count));
  std::vector<BufferSlice> parallel{args.first_moments, args.second_moments};
  if (!outer.pairs) parallel.push_back(args.gradients);
  if (averaged) parallel.push_back(args.averages);
  for (const BufferSlice& slice : parallel)
    if (slice.bytes != args.parameters.bytes)
      throw std::invalid_argument(fmt::format("adam: {} bytes of parameters beside {} bytes of a parallel range",
                                              args.parameters.bytes, slice.bytes));

  shared::AdamConstants constants;
  constants.norm_index = args.norm_index;
  constants.step_size = static_cast<float>(args.rate / (1 - std::pow(args.beta1, args.step)));
  constants.beta1 = static_cast<float>(args.beta1);
  constants.one_minus_beta1 = static_cast<float>(1 - args.beta1);
  constants.beta2 = static_cast<float>(args.beta2);
  constants.one_minus_beta2 = static_cast<float>(1 - args.beta2);
  constants.inverse_correction2 = static_cast<float>(1 / (1 - std::pow(args.beta2, args.step)));
  constants.epsilon = static_cast<float>(args.epsilon);
  constants.weight_decay = static_cast<float>(args.weight_decay);
  constants.one_minus_average_decay = static_cast<float>(1 - args.average_decay);
  constants.gradient_unit = args.gradient_unit;

  constants.pairs = outer.pairs;
  constants.row_stride = outer.row_stride;
  constants.first_column = outer.first_column / 4;
  constants.column_stride = outer.column_stride / 4;

  // Of a matrix its padding is left alone: there is no row for it.
  const uint64_t stepped = outer.pairs ? outer_numbers : count;
  for (uint64_t first = 0; first < stepped; first += optimizer_chunk) {
    const uint64_t floats = std::min(optimizer_chunk, stepped - first);
    constants.eights = static_cast<uint32_t>(floats / 8);
    constants.first_eight = static_cast<uint32_t>(first / 8);
    const auto part = [&](const BufferSlice& slice) { return Binding(slice.elements(first, floats), floats * 4); };
    Launch launch;
    launch.pipeline = &commands.device().pipeline(
        "optimizer/adam", {args.lazy ? 1u : 0u, limited ? 1u : 0u, averaged ? 1u : 0u, on_cpu ? 1u : 0u, outer.pairs ? outer.columns : 0u});
    launch.name = args.lazy ? "adam, lazy" : outer.pairs ? "adam, outer product" : "adam";
    const uint32_t eights_of_group = point_padding * (args.lazy ? shared::lazy_eights : 1);
    launch.groups = {(constants.eights + eights_of_group - 1) / eights_of_group, 1, 1};
    // What is not used needs a buffer all the same.
    const Binding average = part(averaged ? args.averages : args.parameters);
    launch.bindings = {part(args.parameters),
                       outer.pairs ? Binding(outer.b) : part(args.gradients),
                       part(args.first_moments),
                       part(args.second_moments),
                       average,
                       limited ? Binding(args.norms, (uint64_t(args.norm_index) + 1) * sizeof(shared::GradientNorm))
                               : part(args.parameters)};
    for (const BufferSlice& written : {args.parameters, outer.pairs ? args.parameters : args.gradients, args.first_moments, args.second_moments})
      launch.bindings.push_back(part(written));
    launch.bindings.push_back(average);
    launch.bindings.push_back(outer.pairs ? Binding(outer.a) : part(args.parameters));
    launch.push_constants = &constants;
    launch.push_constant_bytes = sizeof(constants);
    launch.after_previous = first == 0;  // chunks touch different numbers
    // Lazy: all gradients are read; how many are not zero, and stepped, is known to the device alone.
    if (args.lazy) launch.cost = {0, static_cast<double>(floats) * 4};
    else launch.cost = {static_cast<double>(floats) * (16 + 2 * outer.pairs), static_cast<double>(floats) * ((averaged ? 36 : 28) - (outer.pairs ? 4 : 0))};
    commands.dispatch(launch);
  }
}

}  // namespace arah
