#include "kernels/linear/linear.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <stdexcept>

#include "kernels/linear/cooperative.h"

namespace arah {
namespace {

enum class Mode : uint32_t { activation, gradient, tangent };  // shaders/lib/epilogue.glsl

// Push constants of the forward shaders: shaders/lib/epilogue.glsl.
struct EpilogueConstants {
  uint64_t weights;
  uint32_t x_stride, x_column;
  uint32_t result_stride, result_column;
  uint32_t second_stride, second_column;
  uint32_t stored_stride, stored_column;
  uint32_t before_stride, before_column;
  uint32_t after_stride, after_column;
  uint32_t outputs;
  uint32_t inputs;
};
static_assert(sizeof(EpilogueConstants) == 64);

struct GeneralArgs {
  Mode mode;
  Activation activation;
  Matrix x;
  uint32_t inputs, outputs;
  BufferSlice packed;
  Matrix result, second, stored, before, after;
  PointRange range;
  const std::string& name;
  std::optional<LinearFamily> family = {};
  BufferSlice halves = {};  // of the weights
};

void require_float32(const std::string& name, const char* what, const Matrix& matrix) {
  if (matrix.element != Element::float32) throw std::invalid_argument(fmt::format("launch '{}': {} is of halves; only the input and the result of a forward layer may be", name, what));
}

void check_matrix(const std::string& name, const char* what, const Matrix& matrix, uint32_t channels, uint32_t points) {
  if (matrix.stride % channel_padding || matrix.column % channel_padding || matrix.column + channels > matrix.stride)
    throw std::invalid_argument(fmt::format("launch '{}': {} has stride {} and column {}, which do not hold {} channels in multiples of {}", name, what,
                                            matrix.stride, matrix.column, channels, channel_padding));
  const uint64_t needs = uint64_t(padded_points(points)) * matrix.stride * bytes_of(matrix.element);
  if (matrix.slice.bytes < needs)
    throw std::invalid_argument(fmt::format("launch '{}': {} needs {} bytes for {} points, '{}' gives {}", name, what, needs, points,
                                            matrix.slice.buffer ? matrix.slice.buffer->name() : "nothing", matrix.slice.bytes));
}

Cost forward_cost(const GeneralArgs& a) {
  const double points = padded_points(a.range.points);
  double beside = 0;
  for (const Matrix* m : {&a.second, &a.stored, &a.before, &a.after}) beside += m->empty() ? 0 : 1;
  return {2.0 * points * a.inputs * a.outputs, points * (bytes_of(a.x.element) * double(a.inputs) + (bytes_of(a.result.element) + 4 * beside) * a.outputs) + 4.0 * double(a.inputs) * a.outputs};
}

void record_general(Commands& commands, const GeneralArgs& a) {
  if (a.inputs % channel_padding || a.outputs % channel_padding || a.inputs == 0 || a.outputs == 0)
    throw std::invalid_argument(fmt::format("launch '{}': {} inputs and {} outputs are not multiples of {}", a.name, a.inputs, a.outputs, channel_padding));
  check_matrix(a.name, "the input", a.x, a.inputs, a.range.points);
  check_matrix(a.name, "the result", a.result, a.outputs, a.range.points);
  for (const auto& [what, matrix] : {std::pair{"the second result", &a.second}, {"the stored activation", &a.stored}, {"the term before", &a.before}, {"the term after", &a.after}})
    if (!matrix->empty()) require_float32(a.name, what, *matrix), check_matrix(a.name, what, *matrix, a.outputs, a.range.points);
  if (a.mode != Mode::activation) require_float32(a.name, "the input", a.x), require_float32(a.name, "the result", a.result);

  Device& device = commands.device();
  const LinearFamily family = a.family ? *a.family : linear_family(device);
  const uint32_t tile = linear_tile(a.inputs, a.outputs);
  const bool cooperative = a.x.element == Element::half && !a.halves.empty();
  if (cooperative && !device.report().cooperative_matrix_missing.empty())
    throw CooperativeMatrixError(fmt::format("launch '{}': cooperative matrices: {}", a.name, device.report().cooperative_matrix_missing));
  const bool shuffled = !cooperative && family == LinearFamily::straight && wide_product(a.inputs, a.outputs);
  // The shuffled kernel's sizes are push constants: 1 and 1 stand for what the others specialise.
  const std::vector<uint32_t> specialization{shuffled ? 1 : a.inputs, shuffled ? 1 : tile, static_cast<uint32_t>(a.mode), static_cast<uint32_t>(a.activation), !a.second.empty(), !a.before.empty(), !a.after.empty(),
                                             a.x.element == Element::half, a.result.element == Element::half};
  const Pipeline& pipeline = device.pipeline(cooperative ? "linear/cooperative_forward" : shuffled ? "linear/shuffled_forward" : family == LinearFamily::straight ? "linear/straight_forward" : "linear/tiled_forward", specialization);

  auto or_input = [&](const Matrix& matrix) { return matrix.empty() ? a.x.slice : matrix.slice; };  // unused bindings need some buffer
  EpilogueConstants constants{};
  const uint32_t x_texel = a.x.element == Element::half ? 8 : 4;
  constants.x_stride = a.x.stride / x_texel, constants.x_column = a.x.column / x_texel;
  constants.second_stride = a.second.stride / 8;
  constants.stored_stride = a.stored.stride / 4, constants.before_stride = a.before.stride / 4, constants.after_stride = a.after.stride / 4;
  constants.result_stride = a.result.stride / 8;
  constants.outputs = a.outputs;
  constants.inputs = a.inputs;

  Launch launch;
  launch.pipeline = &pipeline;
  launch.name = a.name;
  launch.bindings = {a.x.slice, a.result.slice, a.second.empty() ? a.result.slice : a.second.slice, or_input(a.stored), or_input(a.before), or_input(a.after), a.result.slice, a.x.slice};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  set_range(launch, a.range);
  launch.cost = forward_cost(a);

  const uint64_t tile_floats = uint64_t(a.inputs + 1) * tile;
  auto at_column = [&](uint32_t column) {
    constants.result_column = (a.result.column + column) / 8;
    constants.second_column = (a.second.column + column) / 8;
    constants.stored_column = (a.stored.column + column) / 4;
    constants.before_column = (a.before.column + column) / 4;
    constants.after_column = (a.after.column + column) / 4;
    constants.weights = a.packed.buffer->address() + a.packed.offset + column / tile * tile_floats * 4;
  };
  if (cooperative) {
    at_column(0);
    launch.bindings.back() = {a.halves, half_weights_bytes(a.inputs, a.outputs)};  // X's halves are its first binding
    launch.cost.bytes += (2.0 - 4.0) * double(a.inputs) * a.outputs;
    commands.dispatch(launch);
  } else if (shuffled) {
    at_column(0);
    launch.bindings.push_back(a.packed.elements(0, tile_floats));
    commands.dispatch(launch);
  } else if (family == LinearFamily::straight) {
    const uint32_t tiles = a.outputs / tile;
    launch.cost.flops /= tiles;
    launch.cost.bytes /= tiles;
    for (uint32_t t = 0; t < tiles; ++t) {
      at_column(t * tile);
      // Tiles of one layer write different channels; only where the input lies in the same buffer must they wait for each other.
      launch.after_previous = t == 0 || a.x.slice.buffer == a.result.slice.buffer;
      commands.dispatch(launch);
    }
  } else {
    at_column(0);
    launch.groups[1] = (a.outputs + 63) / 64;
    commands.dispatch(launch);
  }
}

}  // namespace

LinearFamily linear_family(const Device& device) {
  if (const char* wanted = std::getenv("ARAH_LINEAR")) {
    const std::string word = wanted;
    if (word == "straight") return LinearFamily::straight;
    if (word == "tiled") return LinearFamily::tiled;
    throw std::invalid_argument("ARAH_LINEAR: expected straight or tiled, found '" + word + "'");
  }
  return device.report().type == DeviceType::cpu ? LinearFamily::straight : LinearFamily::tiled;
}

void set_range(Launch& launch, const PointRange& range) {
  const uint32_t groups = padded_points(range.points) / point_padding;
  launch.groups = {groups, 1, 1};
  launch.indirect = launch.cost_count = range.indirect;
  launch.cost_groups = groups;
}

void record_linear_forward(Commands& commands, const LinearForwardArgs& a) {
  record_general(commands, {Mode::activation, a.activation, a.x, a.weights.inputs, a.weights.outputs, a.weights.forward, a.y, a.cosine, {}, {}, {}, a.range, a.name, a.family, a.weights.halves});
}

void record_linear_input_gradient(Commands& commands, const LinearInputGradientArgs& a) {
  if (a.activation_below != Activation::none && a.stored.empty())
    throw std::invalid_argument("launch '" + a.name + "': the derivative of the activation below needs what that layer stored");
  record_general(commands, {Mode::gradient, a.activation_below, a.dy, a.weights.outputs, a.weights.inputs, a.weights.transposed, a.result, a.raw,
                            a.activation_below == Activation::none ? Matrix{} : a.stored, a.before, a.after, a.range, a.name});
}

void record_linear_tangent(Commands& commands, const LinearTangentArgs& a) {
  record_general(commands, {Mode::tangent, Activation::sine, a.x, a.weights.inputs, a.weights.outputs, a.weights.forward, a.y, a.curvature, a.cosine, a.sine, a.adjoint, a.range, a.name});
}

namespace {

// Points of one partial sum: enough splits to occupy the device (a CPU has few threads, and adding partial sums costs as much
// traffic as a split of 64 points), at most 1,024 points for the sake of float32's rounding.
uint32_t points_per_split(LinearFamily family, uint32_t points) {
  const uint32_t rows = padded_points(points);
  return std::clamp(rows / (family == LinearFamily::straight ? 16 : 64) / 8 * 8, 64u, 1024u);
}
uint32_t weight_gradient_splits(LinearFamily family, uint32_t points) {
  const uint32_t rows = padded_points(points), split = points_per_split(family, points);
  return (rows + split - 1) / split;
}

}  // namespace

uint64_t weight_gradient_scratch_floats(uint32_t inputs, uint32_t outputs, uint32_t points) {
  // room for the family with more splits
  return uint64_t(std::max(weight_gradient_splits(LinearFamily::straight, points), weight_gradient_splits(LinearFamily::tiled, points))) * (inputs + 1) * outputs;
}

void record_linear_weight_gradient(Commands& commands, const LinearWeightGradientArgs& a) {
  require_float32(a.name, "the input", a.x);
  require_float32(a.name, "the gradient", a.dy);
  check_matrix(a.name, "the input", a.x, a.inputs, a.points);
  check_matrix(a.name, "the gradient", a.dy, a.outputs, a.points);
  Device& device = commands.device();
  const LinearFamily family = a.family ? *a.family : linear_family(device);
  const uint32_t rows = padded_points(a.points), splits = weight_gradient_splits(family, a.points);
  const uint64_t texels = uint64_t(a.inputs + 1) * a.outputs / 4;

  struct Constants {
    uint32_t x_stride, x_column, dy_stride, dy_column, row_tiles, column_tiles, inputs, output_texels, points_per_split, points;
  } constants{a.x.stride / 4, a.x.column / 4, a.dy.stride / 4, a.dy.column / 4, 0, 0, a.inputs, a.outputs / 4, points_per_split(family, a.points), rows};
  Launch launch;
  launch.name = a.name;
  launch.bindings = {a.x.slice, a.dy.slice, {a.scratch, texels * 16 * splits}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {2.0 * rows * a.inputs * a.outputs, 4.0 * rows * (a.inputs + a.outputs) + 16.0 * double(texels) * splits};
  if (family == LinearFamily::straight) {
    const uint32_t tile_rows = a.inputs >= 32 ? 32 : 8;
    constants.row_tiles = (a.inputs + tile_rows - 1) / tile_rows;
    constants.column_tiles = (a.outputs + 31) / 32;
    launch.pipeline = &device.pipeline("linear/straight_weight_gradient", {tile_rows});
    launch.groups = {(splits * constants.row_tiles * constants.column_tiles + 7) / 8, 1, 1};
  } else {
    constants.row_tiles = (a.inputs + 63) / 64;
    constants.column_tiles = (a.outputs + 63) / 64;
    launch.pipeline = &device.pipeline("linear/tiled_weight_gradient");
    launch.groups = {constants.row_tiles * constants.column_tiles, splits, 1};
  }
  commands.dispatch(launch);

  struct {
    uint32_t texels, splits, split_stride;
  } sizes{static_cast<uint32_t>(a.with_bias ? texels : texels - a.outputs / 4), splits, static_cast<uint32_t>(texels)};
  Launch reduce;
  reduce.pipeline = &device.pipeline("linear/reduce_partials", {a.accumulate});
  reduce.name = a.name + ": sum of partials";
  reduce.groups = {(sizes.texels + 63) / 64, 1, 1};
  reduce.bindings = {a.scratch.sub(0, texels * 16 * splits), {a.total, texels * 16}};
  reduce.push_constants = &sizes;
  reduce.push_constant_bytes = sizeof sizes;
  reduce.cost = {double(texels) * 4 * splits, 16.0 * double(texels) * (splits + 1)};
  commands.dispatch(reduce);
}

void record_activation_gradient(Commands& commands, const ActivationGradientArgs& a) {
  for (const auto& [what, matrix] : {std::pair{"the gradient", &a.dy}, {"the stored activation", &a.stored}, {"the result", &a.result}}) require_float32(a.name, what, *matrix);
  check_matrix(a.name, "the gradient", a.dy, a.channels, a.points);
  check_matrix(a.name, "the stored activation", a.stored, a.channels, a.points);
  check_matrix(a.name, "the result", a.result, a.channels, a.points);
  const struct {
    uint32_t dy_stride, dy_column, stored_stride, stored_column, result_stride, result_column;
  } constants{a.dy.stride / 4, a.dy.column / 4, a.stored.stride / 4, a.stored.column / 4, a.result.stride / 8, a.result.column / 8};
  Launch launch;
  launch.pipeline = &commands.device().pipeline("linear/activation_gradient", {static_cast<uint32_t>(a.activation)});
  launch.name = a.name;
  launch.groups = {padded_points(a.points) / 64, a.channels / 8, 1};
  launch.bindings = {a.dy.slice, a.stored.slice, a.result.slice};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {4.0 * a.points * a.channels, 12.0 * a.points * a.channels};
  commands.dispatch(launch);
}

}  // namespace arah
