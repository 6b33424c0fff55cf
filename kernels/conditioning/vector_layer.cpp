#include "kernels/conditioning/vector_layer.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <string>

#include "kernels/linear/matrix.h"
#include "kernels/optimizer/chunks.h"
#include "kernels/reduction/sum.h"

namespace arah {
namespace {

uint32_t texels_bytes(uint32_t floats) { return (floats + 3) / 4 * 16; }

uint32_t row_groups(uint32_t rows) { return (rows + shared::gradient_rows - 1) / shared::gradient_rows; }

// Rows of one matrix that are bound together: all of several, which are small.
uint32_t rows_at_a_time(const VectorLayer& layer) {
  if (layer.blocks > 1) return layer.rows;
  return static_cast<uint32_t>(std::min<uint64_t>(layer.rows, optimizer_chunk / layer.columns / shared::gradient_rows * shared::gradient_rows));
}

void check(const VectorLayer& layer) {
  if (layer.own_inputs && layer.columns % 4) throw std::invalid_argument(fmt::format("{}: {} columns of inputs of their own, a multiple of 4 expected", layer.name, layer.columns));
}

}  // namespace

void record_vector_layer(Commands& commands, const VectorLayerArgs& args) {
  const VectorLayer& layer = args.layer;
  check(layer);
  const uint32_t at_a_time = rows_at_a_time(layer);
  for (uint32_t first = 0; first < layer.rows; first += at_a_time) {
    const uint32_t rows = std::min(at_a_time, layer.rows - first), all = rows * layer.blocks;
    const uint64_t numbers = uint64_t(all) * layer.columns;
    const shared::VectorLayerConstants constants{rows, layer.blocks, layer.own_inputs ? layer.columns : 0, args.first_x};
    Launch launch;
    launch.pipeline = &commands.device().pipeline("conditioning/vector_layer", {layer.columns});
    launch.name = layer.name;
    launch.groups = {padded_points(all) / point_padding, 1, 1};
    launch.bindings = {{args.weights.elements(uint64_t(first) * layer.columns, numbers), numbers * 4},
                       {args.x, args.first_x * 4ull + texels_bytes(layer.input_floats())},
                       {args.bias.elements(first, all), all * 4ull},
                       {args.y.elements(first, all), all * 4ull}};
    launch.push_constants = &constants;
    launch.push_constant_bytes = sizeof constants;
    launch.after_previous = first == 0;
    launch.cost = {2.0 * double(numbers), 4.0 * double(numbers)};
    commands.dispatch(launch);
  }
}

uint64_t vector_layer_partials(const VectorLayer& layer) { return uint64_t(row_groups(layer.rows)) * layer.blocks * layer.columns; }

void record_vector_layer_input_gradient(Commands& commands, const VectorLayerInputGradientArgs& args) {
  const VectorLayer& layer = args.layer;
  check(layer);
  if (layer.blocks > 1 && !layer.own_inputs) throw std::invalid_argument(fmt::format("{}: gradient of an input that {} matrices share", layer.name, layer.blocks));
  const std::string name = std::string(layer.name) + ": input gradient";
  const uint32_t at_a_time = rows_at_a_time(layer), width = layer.columns % 4 ? 64 : 256;
  for (uint32_t first = 0; first < layer.rows; first += at_a_time) {
    const uint32_t rows = std::min(at_a_time, layer.rows - first), all = rows * layer.blocks;
    const uint64_t numbers = uint64_t(all) * layer.columns, done = uint64_t(row_groups(first)) * layer.blocks * layer.columns;
    const uint64_t partials = uint64_t(row_groups(rows)) * layer.blocks * layer.columns;
    const shared::VectorLayerConstants constants{rows, layer.blocks, 0, 0};
    Launch launch;
    launch.pipeline = &commands.device().pipeline("conditioning/vector_layer_input_gradient", {layer.columns});
    launch.name = name;
    launch.groups = {(layer.columns + width - 1) / width, row_groups(rows), layer.blocks};
    launch.bindings = {{args.weights.elements(uint64_t(first) * layer.columns, numbers), numbers * 4},
                       {args.d_y.sub(first * 4ull, texels_bytes(all)), texels_bytes(all)},
                       {args.partials.elements(done, partials), partials * 4}};
    launch.push_constants = &constants;
    launch.push_constant_bytes = sizeof constants;
    launch.after_previous = first == 0;
    launch.cost = {2.0 * double(numbers), 4.0 * double(numbers)};
    commands.dispatch(launch);
  }
  SumArgs sum;
  sum.name = "sum of a vector layer's input gradient";
  sum.rows = row_groups(layer.rows);
  sum.columns = layer.blocks * layer.columns;
  sum.partials = args.partials;
  sum.sums = args.d_x;
  sum.sum_index = args.first_x;
  record_sum(commands, sum);
}

void record_vector_layer_weight_gradient(Commands& commands, const VectorLayerWeightGradientArgs& args) {
  const VectorLayer& layer = args.layer;
  check(layer);
  const uint32_t rows = layer.rows * layer.blocks;
  const shared::VectorLayerConstants constants{layer.rows, layer.blocks, layer.own_inputs ? layer.columns : 0, 0};
  const std::string name = std::string(layer.name) + ": weight gradient";
  Launch launch;
  launch.pipeline = &commands.device().pipeline("conditioning/vector_layer_weight_gradient", {layer.columns});
  launch.name = name;
  launch.groups = {static_cast<uint32_t>((layer.numbers() + 63) / 64), 1, 1};
  launch.bindings = {{args.d_y, texels_bytes(rows)}, {args.x, texels_bytes(layer.input_floats())}, {args.d_weights, layer.numbers() * 4}, {args.d_bias, rows * 4ull}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {2.0 * double(layer.numbers()), 8.0 * double(layer.numbers())};
  commands.dispatch(launch);
}

}  // namespace arah
