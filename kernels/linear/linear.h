// The batched linear layer and its two transposes, with fused activations (DESIGN.md §3):
//   forward Y = act(X W + b)      input gradient dX = dY Wᵀ      weight gradient dW = Xᵀ dY
// Two families of shaders behind one interface: `straight` for CPU devices, `tiled` for GPUs. On CPU devices wide products
// take shuffled_forward, a loop, instead of straight-line code.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

enum class LinearFamily { straight, tiled };

// straight on CPU devices, tiled on the others; ARAH_LINEAR=straight|tiled overrides. Throws std::invalid_argument on another word.
LinearFamily linear_family(const Device& device);

// The numbers are those of shaders/lib/activation.glsl. softplus: β = 100; leaky_relu: slope 0.2.
enum class Activation : uint32_t { none, relu, leaky_relu, softplus, sine, sigmoid };

// Effective weights of one layer in the two packings that the kernels read (shaders/linear/pack_weights.comp).
// inputs, outputs: padded to channel_padding.
struct PackedWeights {
  uint32_t inputs = 0;
  uint32_t outputs = 0;
  BufferSlice forward;     // packed_floats(inputs, outputs) floats
  BufferSlice transposed;  // packed_floats(outputs, inputs) floats
  BufferSlice halves;      // empty, or what cooperative.h makes of `forward`: half_weights_bytes(inputs, outputs)
};

// Products with many inputs and outputs: on a CPU device they take the shuffled kernel, whose weights are one tile.
constexpr bool wide_product(uint32_t rows, uint32_t padded_width) { return rows > 128 && padded_width > 16; }

// Width of a tile of packed columns for a product with `rows` inputs: all of a wide product; else the widest multiple of 8 that
// divides the padded width and keeps a tile within 5,120 products a point (code that compiles in one or two seconds and is cut
// into pieces of 512). Wider tiles mean fewer launches and fewer reads of the input.
constexpr uint32_t linear_tile(uint32_t rows, uint32_t padded_width) {
  if (wide_product(rows, padded_width)) return padded_width;
  uint32_t tile = padded_width;
  while (tile > channel_padding && (padded_width % tile != 0 || rows * tile > 5120)) tile -= channel_padding;
  return tile;
}
constexpr uint64_t packed_floats(uint32_t rows, uint32_t columns) { return uint64_t(rows + 1) * columns; }

// Where a launch takes its number of points from: `points` (padded to 64 by the kernel), or, where given, the device's own
// WorkCount (shaders/shared/work_count.h) in groups of 64; `points` is then the capacity, for checks and costs.
struct PointRange {
  uint32_t points = 0;
  BufferSlice indirect;
};
// Gives the launch a workgroup for every 64 points of the range. launch.cost is that of all `points`.
void set_range(Launch& launch, const PointRange& range);

// Y = act(X W + b). X: [points][inputs]; Y: [points][outputs]; cosine (sine only, optional): cos of the pre-activation.
// X and Y may be of halves, each for itself: products and sums are float32 all the same, and Y is rounded to the nearest half.
// Where X is of halves and the weights have halves too, these are multiplied on the device's matrix units (cooperative.h).
struct LinearForwardArgs {
  Matrix x;
  PackedWeights weights;
  Matrix y;
  Activation activation = Activation::none;
  Matrix cosine;
  PointRange range;
  std::string name = "linear forward";
  std::optional<LinearFamily> family;  // none: linear_family
};
void record_linear_forward(Commands& commands, const LinearForwardArgs& args);

// r = dY Wᵀ + before;  result = r ⊙ act'(stored) + after;  raw (optional) = r.
// dY: [points][outputs] gradient at this layer's pre-activation. `stored` is what the layer below stored going forward: its
// value, or its cosine for a sine; Activation::none: nothing is stored and act' = 1. Matrices of the result: [points][inputs].
struct LinearInputGradientArgs {
  Matrix dy;
  PackedWeights weights;
  Matrix result;
  Activation activation_below = Activation::none;
  Matrix stored;
  Matrix before;
  Matrix after;
  Matrix raw;
  PointRange range;
  std::string name = "linear input gradient";
};
void record_linear_input_gradient(Commands& commands, const LinearInputGradientArgs& args);

// Forward tangent through a sine layer: a = X W (no bias: X is a tangent), y = a ⊙ cosine, curvature = −sine ⊙ a ⊙ adjoint.
// sine, cosine: of the layer's phase; adjoint: ∂f/∂(layer's value).
struct LinearTangentArgs {
  Matrix x;
  PackedWeights weights;
  Matrix y;
  Matrix cosine;
  Matrix sine;
  Matrix adjoint;
  Matrix curvature;
  PointRange range;
  std::string name = "linear tangent";
};
void record_linear_tangent(Commands& commands, const LinearTangentArgs& args);

// total [inputs + 1][outputs] (=, or += with accumulate): rows 0..inputs−1 Xᵀ dY, the last row Σ dY (the bias's gradient).
// All padded rows of X and dY are read: rows beyond the real points must be finite in X and zero in dY.
// scratch: at least weight_gradient_scratch_floats. Sums in a fixed order that depends on the padded sizes alone.
struct LinearWeightGradientArgs {
  Matrix x;
  Matrix dy;
  uint32_t inputs = 0;   // padded
  uint32_t outputs = 0;  // padded
  uint32_t points = 0;
  bool accumulate = false;
  bool with_bias = true;  // false: the last row of total stays as it is (X is a tangent, which has no bias)
  BufferSlice scratch;
  BufferSlice total;
  std::string name = "linear weight gradient";
  std::optional<LinearFamily> family;  // none: linear_family
};
uint64_t weight_gradient_scratch_floats(uint32_t inputs, uint32_t outputs, uint32_t points);
void record_linear_weight_gradient(Commands& commands, const LinearWeightGradientArgs& args);

// result = dY ⊙ act'(stored), channels wide: for activations that no input gradient passes through (a network's last).
struct ActivationGradientArgs {
  Matrix dy;
  Matrix stored;
  Matrix result;
  Activation activation = Activation::none;
  uint32_t channels = 0;  // padded
  uint32_t points = 0;
  std::string name = "activation gradient";
};
void record_activation_gradient(Commands& commands, const ActivationGradientArgs& args);

}  // namespace arah
