// An avatar's parameters on the device, and the networks that read them. Only the parts that the spec names are built.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "kernels/color/assemble_inputs.h"
#include "kernels/color/feature_grid.h"
#include "kernels/linear/dense_network.h"
#include "kernels/sdf/siren.h"
#include "kernels/skinning/joint_tree.h"

namespace arah {

class AvatarNetworks {
 public:
  // Uploads the parameters. with_gradients: also a gradient buffer of the same layout, for training.
  AvatarNetworks(Device& device, const Avatar& avatar, bool with_gradients);

  const AvatarSpec& spec() const { return spec_; }
  const ParameterLayout& layout() const { return layout_; }
  const CubeNormalization& cube() const { return cube_; }
  const JointTree& tree() const { return tree_; }
  const FeatureGridShape& grid() const { return grid_; }
  bool has_gradients() const { return gradients_.bytes() > 0; }

  BufferSlice parameters() { return parameters_.slice(); }
  BufferSlice gradients() { return gradients_.slice(); }
  BufferSlice parameter(const std::string& slot) { return slice_of(parameters_, slot); }
  BufferSlice gradient(const std::string& slot) { return slice_of(gradients_, slot); }
  uint32_t deviation_index() const { return static_cast<uint32_t>(layout_.slot("b").offset); }  // of b's parameter

  // The code of a row of `latent`, and its gradient; empty where the spec has none. Rows are padded by the layout only as a
  // whole, so the code is copied to a buffer of its own before the weights are packed.
  BufferSlice code() { return spec_.latent_size ? code_.slice() : BufferSlice{}; }
  BufferSlice code_gradient() { return spec_.latent_size && has_gradients() ? code_gradient_.slice() : BufferSlice{}; }

  // For pictures with cooperative matrices: the SDF's and the colour's inner layers keep weights of halves too, from the next
  // record_pack on.
  void make_half_weights(Device& device);
  // Packs all weights for the frames that use row `latent_row`: after every change of parameters or of the row.
  void record_pack(Commands& commands, std::size_t latent_row);
  // Effective gradients of the parts → raw gradients (+=), the code's gradient → row `latent_row` of latent's (=).
  // scratch: unpack_scratch() floats.
  struct Parts {
    bool sdf = true, skinning = true, color = true;
  };
  void record_unpack(Commands& commands, std::size_t latent_row, const Parts& parts, const BufferSlice& scratch);
  uint64_t unpack_scratch() const;  // floats

  const std::vector<std::array<float, 4>>& bone_segments() const { return bone_segments_; }  // two a bone: its canonical ends

  Siren& sdf() { return *sdf_; }
  DenseNetwork& skinning() { return *skinning_; }  // only with Skinning::network
  DenseNetwork& color() { return *color_; }
  SirenShape sdf_shape() const;
  DenseShape skinning_shape() const;
  DenseShape color_shape() const;
  ColorRow color_row() const;

 private:
  BufferSlice slice_of(Buffer& buffer, const std::string& slot);
  LayerTensors tensors(Buffer& buffer, const std::string& prefix, const char* weight, const char* first);

  AvatarSpec spec_;
  ParameterLayout layout_;
  CubeNormalization cube_;
  JointTree tree_;
  std::vector<std::array<float, 4>> bone_segments_;
  FeatureGridShape grid_;
  Buffer parameters_, gradients_, code_, code_gradient_;
  std::optional<Siren> sdf_;
  std::optional<DenseNetwork> skinning_, color_, mapping_;
  std::optional<DenseTape> mapping_tape_;
};

}  // namespace arah
