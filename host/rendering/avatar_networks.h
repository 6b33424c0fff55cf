// An avatar's parameters on the device, and the networks that read them. Only the parts that the spec names are built.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "kernels/color/assemble_inputs.h"
#include "kernels/color/feature_grid.h"
#include "kernels/conditioning/pose_networks.h"
#include "kernels/linear/dense_network.h"
#include "kernels/sdf/siren.h"
#include "kernels/skinning/joint_tree.h"

namespace arah {

class AvatarNetworks {
 public:
  // Uploads the parameters. with_gradients: also a gradient buffer of the same layout up to the group hyper_last, for training.
  // frames: of a step, at most.
  AvatarNetworks(Device& device, const Avatar& avatar, bool with_gradients, uint32_t frames = 1);

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

  // The code of a row of `latent`, and its gradient; empty where the spec has none. Rows are padded by the layout only as a
  // whole, so the code is copied to a buffer of its own before the weights are packed.
  BufferSlice code() { return spec_.latent_size ? code_.slice() : BufferSlice{}; }
  BufferSlice code_gradient() { return spec_.latent_size && has_gradients() ? code_gradient_.slice() : BufferSlice{}; }

  // For pictures with cooperative matrices: the SDF's and the colour's inner layers keep weights of halves too, from the next
  // record_pack on.
  void make_half_weights(Device& device);
  // Skinning::backward: the pose that the next record_pack is for, of FrameOnDevice::joint_rotations; nothing for other kinds.
  void record_pose(Commands& commands, const BufferSlice& joint_rotations);
  // Packs all weights for the frames that use row `latent_row` and the pose: after every change of parameters, row or pose.
  // pose: what pose_input() gives; it is uploaded at once, so what was recorded before with another pose must have run. Empty:
  // the SDF that all poses share. Throws std::invalid_argument where it has another size.
  void record_pack(Commands& commands, std::size_t latent_row, std::span<const float> pose);
  // Effective gradients of the parts → raw gradients (+=). scratch: unpack_scratch() floats. frame: number of the frame in its
  // step; the gradients of hyper_last are the outer products of all of them (pose_networks()). pose_regulariser: weight of the
  // loss on the size of the generated parameters, whose value goes to losses[slot] (+=).
  struct Parts {
    bool sdf = true, skinning = true, color = true;
  };
  // What it reads: the gradients at the effective weights of the SDF, the skinning and the colour network, where they are among
  // the parts. Several devices that each have them for some of a frame's rays add these up, of a hypernetwork's 85 million numbers
  // the factors alone.
  std::vector<BufferSlice> effective_gradients(const Parts& parts);
  struct PoseRegulariser {
    float weight = 0;
    BufferSlice losses;
    uint32_t slot = 0;
  };
  void record_unpack(Commands& commands, std::size_t latent_row, const Parts& parts, const BufferSlice& scratch, uint32_t frame = 0, const PoseRegulariser& pose_regulariser = {0, {}, 0});
  // The gradients of hyper_last over the first `frames` frames of a step, by tensor.
  struct LastGradient {
    const TensorSlot& slot;
    OuterProduct product;
  };
  std::vector<LastGradient> hyper_last_gradients(uint32_t frames);
  // After the last record_unpack has run: dL/d(pose) as pose_input() lays it out; empty where the SDF follows no pose.
  std::vector<float> download_pose_gradient(Device& device);
  // Packing and the way back of the SDF alone, of the one that all poses share, and not on to the code.
  void record_pack_shared_sdf(Commands& commands);
  void record_unpack_shared_sdf(Commands& commands);
  uint64_t unpack_scratch() const;  // floats

  const std::vector<std::array<float, 4>>& bone_segments() const { return bone_segments_; }  // two a bone: its canonical ends

  Siren& sdf() { return *sdf_; }
  PoseNetworks& pose_networks() { return *pose_networks_; }  // only where the SDF follows the pose
  DenseNetwork& skinning() { return *skinning_; }  // only with SkinningSpec::learned()
  DenseNetwork& color() { return *color_; }
  SirenShape sdf_shape() const;
  PoseNetworksShape pose_networks_shape() const;  // only where the SDF follows the pose
  DenseShape skinning_shape() const;
  DenseShape color_shape() const;
  ColorRow color_row() const;

 private:
  BufferSlice slice_of(Buffer& buffer, const std::string& slot);
  BufferSlice padded_slice_of(Buffer& buffer, const std::string& slot);
  PoseNetworksTensors pose_tensors(Buffer& buffer);
  LayerTensors tensors(Buffer& buffer, const std::string& prefix, const char* weight, const char* first);

  AvatarSpec spec_;
  ParameterLayout layout_;
  CubeNormalization cube_;
  JointTree tree_;
  std::vector<std::array<float, 4>> bone_segments_;
  FeatureGridShape grid_;
  Buffer parameters_, gradients_, code_, code_gradient_, pose_;
  std::optional<PoseNetworks> pose_networks_;
  std::optional<Siren> sdf_;
  std::optional<DenseNetwork> skinning_, color_, mapping_;
  std::optional<DenseTape> mapping_tape_;
};

}  // namespace arah
