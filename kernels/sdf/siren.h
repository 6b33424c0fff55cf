// The canonical signed-distance field: a SIREN (paper App. "Canonical SDF Network"; ARAH.md §1) with value, feature, input
// gradient and the second-order backward pass that normals and the eikonal term need.
//   h_0 = n(x),  φ_i = ω(γ_i ⊙ (W_i h_i + b_i) + η_i),  h_{i+1} = sin φ_i,  f = W_L h_L + b_L,  feature z = h_L
// FiLM and ω are folded into the packed weights (layer.h), so each layer is one product and one sine.
#pragma once

#include <string>
#include <vector>

#include "kernels/linear/layer.h"

namespace arah {

struct SirenShape {
  uint32_t width = 64;
  uint32_t sine_layers = 4;
  float omega = 30;
  bool film = false;  // γ, η given per layer
};

// Activations of one pass over at most `capacity` points, all matrices zero at first.
class SirenTape {
 public:
  enum class Holds { values, gradient, first_order, second_order };
  // values: forward only, two layers' activations at a time. gradient: also what ∂f/∂n needs. first_order: also what the
  // backward pass without a cotangent on it needs. second_order: also what a cotangent on the gradient needs.
  // hidden: what the sines are stored as that only the next layer reads; with halves there is no backward pass. feature: it is
  // read, so that it is float32.
  SirenTape(Device& device, const std::string& name, const SirenShape& shape, uint32_t capacity, Holds holds, Element hidden = Element::float32, bool feature = true);

  uint32_t capacity() const { return capacity_; }
  Matrix input();              // [8]: n(x) in channels 0..2, the rest zero; the caller writes it
  Matrix sdf();                // [8]: f in channel 0, cube units
  Matrix feature();            // [width]: z; throws std::logic_error where it is of halves
  Matrix gradient();           // [8]: ∂f/∂n in channels 0..2 (record_gradient)
  Matrix sdf_cotangent();      // [8]: dL/df in channel 0, the rest zero; the caller writes it
  Matrix feature_cotangent();  // [width]: dL/dz; the caller writes it
  Matrix gradient_cotangent(); // [8]: dL/d(∂f/∂n) in channels 0..2, the rest zero (second_order)
  Matrix input_gradient();     // [8]: dL/dn

 private:
  friend class Siren;
  uint32_t capacity_;
  std::vector<Buffer> buffers_;
  Matrix input_, sdf_, gradient_, sdf_cotangent_, feature_cotangent_, gradient_cotangent_, input_gradient_, ones_;
  std::vector<Matrix> sine_, cosine_;          // per sine layer: h_{i+1} and cos φ_i
  std::vector<Matrix> adjoint_, phase_adjoint_;  // ∂f/∂h_{i+1} and ∂f/∂φ_i (record_gradient)
  std::vector<Matrix> tangent_, curvature_;      // ḣ_{i+1} and −sin φ · φ̇ · ∂f/∂h
  std::vector<Matrix> loss_adjoint_;             // dL/dφ_i
};

// Recording throws std::invalid_argument where the tape holds too little.
class Siren {
 public:
  // Tensors: sine_layers + 1 layers, the last one linear.
  Siren(Device& device, const std::string& name, const SirenShape& shape, const std::vector<LayerTensors>& parameters, const std::vector<LayerTensors>& gradients);

  const SirenShape& shape() const { return shape_; }
  void record_pack(Commands& commands);
  // Layers between two sine layers keep weights of halves from the next record_pack on (Layer::make_half_weights).
  void make_half_weights(Device& device);
  // tape.input() → tape.sdf(), tape.feature(). keep: also the cosines, for what follows.
  void record_forward(Commands& commands, SirenTape& tape, const PointRange& range, bool keep);
  // After record_forward(keep): tape.gradient(). keep_adjoints: what a second-order backward pass will read.
  void record_gradient(Commands& commands, SirenTape& tape, const PointRange& range, bool keep_adjoints);

  // Back from L = Σ_points a f + G·z + v·∂f/∂n with a, G, v in the tape's cotangents (those that are switched on):
  // effective weight gradients (=, or += with accumulate) and, where asked for, tape.input_gradient().
  // gradient_cotangent needs record_gradient(keep_adjoints) before. All padded rows of the cotangents must be finite and zero
  // beyond the real points.
  struct Backward {
    bool feature = false;
    bool gradient = false;
    bool accumulate = false;
    bool input_gradient = false;
    BufferSlice scratch;  // weight_gradient_scratch floats
  };
  void record_backward(Commands& commands, SirenTape& tape, const PointRange& range, const Backward& backward);
  uint64_t weight_gradient_scratch(uint32_t points) const;
  std::vector<BufferSlice> effective_gradients();  // by layer
  void record_unpack(Commands& commands);

 private:
  std::string name_;
  SirenShape shape_;
  std::vector<Layer> layers_;
};

}  // namespace arah
