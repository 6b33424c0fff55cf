// One linear layer of a network: how its raw parameters become effective weights, and how gradients come back to them
// (formulas in shaders/lib/parameterisation.glsl).
#pragma once

#include <cstdint>
#include <string>

#include "kernels/linear/linear.h"

namespace arah {

enum class LayerKind : uint32_t { plain, weight_norm, film };

struct LayerShape {
  LayerKind kind = LayerKind::plain;
  uint32_t inputs = 0;  // raw columns of W
  uint32_t outputs = 0;
  uint32_t constant_first = 0;  // raw columns [first, first + count) are constant over a batch: a frame's latent code
  uint32_t constant_count = 0;
  uint32_t gap_first = 0;  // effective rows [first, first + count) read nothing: alignment of a concatenated input
  uint32_t gap_count = 0;
  float omega = 1;  // factor of the pre-activation (SIREN: 30); weight norm ignores it

  uint32_t padded_inputs() const { return padded_channels(inputs - constant_count + gap_count); }
  uint32_t padded_outputs() const { return padded_channels(outputs); }
};

// Raw tensors, each a slice of the flat parameter buffer (or of the flat gradient buffer, in the same order).
struct LayerTensors {
  BufferSlice weight;  // [outputs][inputs]
  BufferSlice bias;    // [outputs]
  BufferSlice first;   // weight norm: g [outputs]; FiLM: gamma [outputs]; else empty
  BufferSlice shift;   // FiLM: eta [outputs]; else empty
};

// A layer ready to run: its effective weights and the gradient at them.
class Layer {
 public:
  Layer(Device& device, const std::string& name, const LayerShape& shape, const LayerTensors& parameters, const LayerTensors& gradients);

  const LayerShape& shape() const { return shape_; }
  const std::string& name() const { return name_; }
  PackedWeights packed();
  // From now on record_pack also makes the weights of halves for cooperative matrices; nothing where no size of the layer fits
  // these (cooperative.h).
  void make_half_weights(Device& device);
  BufferSlice effective_gradient() { return effective_gradient_.slice(); }  // [padded inputs + 1][padded outputs]

  // Raw parameters → both packings. code: the constant inputs [constant_count], empty where there are none.
  void record_pack(Commands& commands, const BufferSlice& code = {});

  // effective_gradient → raw gradients (+=), and the gradient of the constant inputs (+=) where code_gradient is given.
  // Reads the scales of the last record_pack.
  void record_unpack(Commands& commands, const BufferSlice& code = {}, const BufferSlice& code_gradient = {});

 private:
  std::string name_;
  LayerShape shape_;
  LayerTensors parameters_, gradients_;
  Buffer forward_, transposed_, scales_, effective_gradient_, halves_;
};

}  // namespace arah
