// The SIREN's parameters of a pose (paper App. "Canonical SDF Network"; ARAH.md §1): pose → code (pose_code.h) → one small
// network a SIREN layer → h, and a change of the layer's shared parameters φ₀ that is linear in h:
//   dense     φ = φ₀ + W h: the paper's hypernetwork, whose last layers hold nearly all of its numbers
//   low rank  W = W₀ + Σ_r h_r u_r v_rᵀ,  b = b₀ + C h (low_rank.h)
// Both begin at φ₀, where W, or U and C, are zero. φ₀ stands for the bias of the last layer, too.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "kernels/conditioning/layer_norm.h"
#include "kernels/conditioning/low_rank.h"
#include "kernels/conditioning/pose_code.h"
#include "kernels/conditioning/vector_layer.h"
#include "kernels/linear/layer.h"
#include "kernels/losses/parameter_norm.h"
#include "kernels/optimizer/outer_product.h"

namespace arah {

enum class PoseChange { low_rank, dense };

struct PoseNetworksShape {
  PoseChange change = PoseChange::low_rank;
  std::vector<int> parents;  // the joint tree, parents first, −1 for the root
  uint32_t width = 0;        // of h and of the layers before it: the rank of the change, a multiple of 8
  uint32_t hidden_layers = 1;
  std::vector<std::array<uint32_t, 2>> layers;  // of the SIREN: outputs, inputs

  uint32_t joints() const { return static_cast<uint32_t>(parents.size()); }
  uint32_t code() const { return joints() * shared::pose_features; }
};

// Slices of the flat parameter buffer, or of the gradients, each padded to 64 floats.
struct PoseNetworksTensors {
  BufferSlice encoder;
  struct Hidden {
    BufferSlice w;                // [layers][width][inputs]
    BufferSlice b, scale, shift;  // [layers][width]
  };
  std::vector<Hidden> hidden;
  struct Change {
    BufferSlice base_w, base_b;    // φ₀: [outputs][inputs], [outputs]
    BufferSlice dense_w, dense_b;  // [outputs · inputs][width], [outputs][width]; no gradients: those are outer products
    LowRankTensors low_rank;
  };
  std::vector<Change> layers;
};

class PoseNetworks {
 public:
  // gradients: of everything but dense_w and dense_b; default: none, and no backward pass. frames: of a step, whose outer
  // products are kept. Throws std::invalid_argument where sizes do not fit.
  PoseNetworks(Device& device, const std::string& name, const PoseNetworksShape& shape, const PoseNetworksTensors& parameters,
                   const shared::PoseEncoderConstants& encoder_at, const PoseNetworksTensors* gradients, uint32_t frames = 1);

  const PoseNetworksShape& shape() const { return shape_; }
  BufferSlice pose() { return pose_.slice(); }           // float [joints][9], [joints][3]: the caller uploads it (pose_code.h)
  BufferSlice pose_gradient() { return d_pose_.slice(); }
  // W and b of the SIREN's layer l, and where the SIREN leaves their gradients (+=).
  LayerTensors generated(uint32_t l) { return tensors(generated_, l); }
  LayerTensors generated_gradient(uint32_t l) { return d_generated_.bytes() ? tensors(d_generated_, l) : LayerTensors{}; }

  // pose() → generated()
  void record_forward(Commands& commands);
  // φ₀ → generated(): the SIREN that all poses share, and the way back from generated_gradient() to it (+=).
  void record_shared(Commands& commands);
  void record_shared_backward(Commands& commands);
  // Before the first gradient of a frame.
  void record_clear_gradient(Commands& commands);
  // The regulariser's value and its part of generated_gradient(); after record_forward.
  void record_parameter_norm(Commands& commands, float weight, const BufferSlice& losses, uint32_t slot);
  // generated_gradient() → raw gradients (+=) and pose_gradient() (=), as frame number `frame` of the step.
  void record_backward(Commands& commands, uint32_t frame = 0);

  // Dense: the gradients of dense_w and dense_b of layer l over the first `frames` frames of the step.
  OuterProduct dense_w_gradient(uint32_t l, uint32_t frames = 1);
  OuterProduct dense_b_gradient(uint32_t l, uint32_t frames = 1);

 private:
  struct Place {  // of a tensor in generated_, floats
    uint64_t at = 0, count = 0;
  };
  LayerTensors tensors(Buffer& buffer, uint32_t l);
  VectorLayer hidden_layer(uint32_t i) const;
  VectorLayer dense_layer(uint32_t l, bool bias) const;
  PoseCodeArgs code_args();
  LayerNormArgs norm_args(uint32_t i);
  OuterProduct outer(uint32_t l, const Place& place, uint32_t frames);

  std::string name_;
  PoseNetworksShape shape_;
  PoseNetworksTensors parameters_, gradients_;
  shared::PoseEncoderConstants encoder_at_;
  std::vector<Place> weights_, biases_;
  uint64_t generated_floats_ = 0;
  Buffer parents_, pose_, inputs_, hidden_, code_, generated_;
  struct HiddenBuffers {
    Buffer a, normalised, inverse_deviation, y, d_a, d_y;
  };
  std::vector<HiddenBuffers> layers_;
  Buffer d_pose_, d_code_, d_generated_, partials_, squares_, norm_;
  Buffer kept_d_generated_, kept_h_;  // [frames], dense alone
};

}  // namespace arah
