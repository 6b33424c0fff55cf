// A chain of linear layers with activations: the skinning, colour and mapping networks.
// With a skip, the network's input is concatenated in front of the activations that enter one of the layers.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "kernels/linear/layer.h"

namespace arah {

struct DenseShape {
  std::vector<LayerShape> layers;  // inputs and outputs chain; the skip layer's raw inputs are [input, hidden]
  std::vector<Activation> activations;
  int skip = -1;  // layer before which the input is concatenated: [input, gap, hidden]; −1: none

  // Effective width of the input: what its Matrix must hold.
  uint32_t padded_input() const { return layers[0].padded_inputs(); }
  // A plain chain: widths w_0 → w_1 → … → w_n, `hidden` between, `last` at the end, constant inputs last in the input.
  static DenseShape chain(LayerKind kind, const std::vector<uint32_t>& widths, Activation hidden, Activation last, uint32_t constant_inputs = 0);
  // Concatenates the input before layer `at`: that layer's raw inputs become [input, hidden] with the input's constant part.
  // Throws std::invalid_argument where there is a skip already, or `at` is no layer after the first.
  DenseShape with_skip(int at) const;
};

// What one forward pass leaves for the backward pass, for a fixed capacity of points.
class DenseTape {
 public:
  // with_gradients: also what the backward pass needs; else two layers' values at a time.
  // hidden: what the layers' values are stored as that only the next layer reads: not the output, and not what shares its rows
  // with the input. Throws std::invalid_argument for halves with gradients.
  DenseTape(Device& device, const std::string& name, const DenseShape& shape, uint32_t capacity, bool with_gradients, Element hidden = Element::float32);

  uint32_t capacity() const { return capacity_; }
  Matrix input();              // the caller writes here: padded_input() channels, all of them
  Matrix output();             // value of the last layer after its activation
  Matrix output_gradient();    // the caller writes dL/d(output) here before record_backward
  Matrix input_gradient();     // written by record_backward where asked for: padded_input() channels

 private:
  friend class DenseNetwork;
  uint32_t capacity_;
  DenseShape shape_;
  std::vector<Buffer> buffers_;
  std::vector<Matrix> values_;    // [layers + 1]: the input, then each layer's value
  std::vector<Matrix> adjoints_;  // [layers]: gradient at each layer's pre-activation
  Matrix joined_;                 // input of the skip layer: [input, hidden]
  Matrix output_gradient_, input_gradient_, joined_gradient_;
};

class DenseNetwork {
 public:
  // parameters and gradients: one LayerTensors a layer. Throws std::invalid_argument where the counts differ, and for sines:
  // the backward pass has the activations' values alone (sdf/siren.h keeps cosines).
  DenseNetwork(Device& device, const std::string& name, const DenseShape& shape, const std::vector<LayerTensors>& parameters,
               const std::vector<LayerTensors>& gradients);

  const DenseShape& shape() const { return shape_; }
  // Raw parameters → packed weights. code: constant inputs, see LayerShape.
  void record_pack(Commands& commands, const BufferSlice& code = {});
  // Layers that read no part of the network's input keep weights of halves from the next record_pack on
  // (Layer::make_half_weights).
  void make_half_weights(Device& device);
  // tape.input() → tape.output() for range.points ≤ capacity.
  void record_forward(Commands& commands, DenseTape& tape, const PointRange& range);
  // From `cotangent` at the output (default: tape.output_gradient()): effective weight gradients (=, or += with accumulate)
  // unless weight_gradients is off, and the input gradient where asked for. scratch: weight_gradient_scratch().
  struct Backward {
    Matrix cotangent;
    bool weight_gradients = true;
    bool accumulate = false;
    bool input_gradient = false;
    BufferSlice scratch;
    // At layer 0's input gradient; default tape.input_gradient().
    Matrix input_gradient_result;
  };
  void record_backward(Commands& commands, DenseTape& tape, const PointRange& range, const Backward& backward);
  uint64_t weight_gradient_scratch(uint32_t points) const;  // floats
  std::vector<BufferSlice> effective_gradients();           // by layer
  // Effective gradients → raw gradients (+=).
  void record_unpack(Commands& commands, const BufferSlice& code = {}, const BufferSlice& code_gradient = {});

 private:
  std::string name_;
  DenseShape shape_;
  std::vector<Layer> layers_;
};

}  // namespace arah
