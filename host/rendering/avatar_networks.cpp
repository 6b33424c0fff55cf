#include "host/rendering/avatar_networks.h"

#include <algorithm>
#include <stdexcept>

#include "host/body/canonical.h"

namespace arah {
namespace {

FeatureGridShape grid_shape(const GridExtent& extent) {
  FeatureGridShape shape;
  for (int axis = 0; axis < 3; ++axis) {
    shape.lower[static_cast<size_t>(axis)] = extent.lower[axis];
    shape.upper[static_cast<size_t>(axis)] = extent.upper[axis];
  }
  shape.levels = static_cast<uint32_t>(extent.nodes.size());
  for (size_t level = 0; level < extent.nodes.size(); ++level) shape.nodes[level] = {extent.nodes[level].x, extent.nodes[level].y, extent.nodes[level].z};
  return shape;
}

static_assert(kPoseChannels == shared::pose_channels && kPoseFeatures == shared::pose_features && kPoseHidden == shared::pose_hidden);

}  // namespace

SirenShape AvatarNetworks::sdf_shape() const {
  return {spec_.sdf.width, spec_.sdf.sine_layers, static_cast<float>(spec_.sdf.omega), spec_.sdf.conditioning == SdfConditioning::latent};
}

PoseNetworksShape AvatarNetworks::pose_networks_shape() const {
  PoseNetworksShape shape{spec_.sdf.pose == PoseConditioning::hypernetwork ? PoseChange::dense : PoseChange::low_rank, tree_.parents(), spec_.sdf.pose_width, spec_.sdf.pose_hidden_layers, {}};
  const std::vector<uint32_t> widths = sdf_widths(spec_);
  for (size_t l = 0; l + 1 < widths.size(); ++l) shape.layers.push_back({widths[l + 1], widths[l]});
  return shape;
}

DenseShape AvatarNetworks::skinning_shape() const {
  return DenseShape::chain(LayerKind::weight_norm, skinning_widths(spec_, tree_.logits(), tree_.joints()), Activation::softplus, Activation::none,
                           spec_.skinning.kind == Skinning::backward ? pose_inputs(tree_.joints()) : 0);
}

DenseShape AvatarNetworks::color_shape() const {
  const DenseShape chain = DenseShape::chain(LayerKind::weight_norm, color_widths(spec_), Activation::relu, Activation::sigmoid, spec_.color.latent ? spec_.latent_size : 0);
  return spec_.color.skip < 0 ? chain : chain.with_skip(spec_.color.skip);
}

ColorRow AvatarNetworks::color_row() const { return {spec_.color.view, spec_.color.normal, spec_.color.feature ? spec_.sdf.width : 0, spec_.color.directions == DirectionSpace::canonical}; }

AvatarNetworks::AvatarNetworks(Device& device, const Avatar& avatar, bool with_gradients, uint32_t frames)
    : spec_(avatar.spec), layout_(avatar.layout), cube_(avatar.cube), tree_(avatar.body.skeleton.parents), grid_(grid_shape(avatar.grid)) {
  for (const auto& [from, to] : arah::bone_segments(avatar.body.skeleton, avatar.canonical))
    for (const glm::dvec3& end : {from, to}) bone_segments_.push_back({static_cast<float>(end.x), static_cast<float>(end.y), static_cast<float>(end.z), 0});
  parameters_ = Buffer(device, "parameters", layout_.floats * 4, BufferPlace::device);
  device.upload(parameters_.slice(), avatar.parameters);
  if (with_gradients) {
    gradients_ = Buffer(device, "gradients", layout_.group("hyper_last").begin * 4, BufferPlace::device);
    Commands zero(device);
    zero.fill(gradients_.slice(), 0);
    zero.submit_and_wait();
  }
  if (spec_.latent_size) {
    code_ = Buffer(device, "latent code of the frame", spec_.latent_size * 4, BufferPlace::device);
    if (with_gradients) code_gradient_ = Buffer(device, "gradient of the latent code", spec_.latent_size * 4, BufferPlace::device);
  }

  // Without gradients the gradient slices stay empty; nothing reads them.
  auto layers = [&](Buffer& buffer, const std::string& network, size_t count, const char* weight, const char* first) {
    std::vector<LayerTensors> all;
    for (size_t i = 0; i < count; ++i) all.push_back(buffer.bytes() ? tensors(buffer, network + "." + std::to_string(i), weight, first) : LayerTensors{});
    return all;
  };
  auto dense = [&](std::optional<DenseNetwork>& network, const std::string& name, const DenseShape& shape, const char* weight, const char* first) {
    network.emplace(device, name, shape, layers(parameters_, name, shape.layers.size(), weight, first), layers(gradients_, name, shape.layers.size(), weight, first));
  };

  const SirenShape siren = sdf_shape();
  std::vector<LayerTensors> sdf_parameters = layers(parameters_, "sdf", siren.sine_layers + 1, "W", ""), sdf_gradients = layers(gradients_, "sdf", siren.sine_layers + 1, "W", "");
  if (spec_.sdf.pose != PoseConditioning::none) {
    shared::PoseEncoderConstants at{};
    const uint64_t begin = layout_.group("pose_code").begin;
    const auto place = [&](const char* tensor) { return static_cast<uint32_t>(layout_.slot(std::string("pose_code.") + tensor).offset - begin); };
    at.global_w = place("global.W"), at.global_b = place("global.b");
    at.w1 = place("1.W"), at.b1 = place("1.b"), at.w2 = place("2.W"), at.b2 = place("2.b");
    const PoseNetworksTensors gradients = with_gradients ? pose_tensors(gradients_) : PoseNetworksTensors{};
    pose_networks_.emplace(device, "pose networks", pose_networks_shape(), pose_tensors(parameters_), at, with_gradients ? &gradients : nullptr, frames);
    for (uint32_t l = 0; l <= siren.sine_layers; ++l) sdf_parameters[l] = pose_networks_->generated(l), sdf_gradients[l] = pose_networks_->generated_gradient(l);
  }
  if (siren.film) {
    // The mapping network's one output row holds all γ, then all η.
    const DenseShape mapping = DenseShape::chain(LayerKind::plain, mapping_widths(spec_), Activation::leaky_relu, Activation::none);
    dense(mapping_, "mapping", mapping, "W", "");
    mapping_tape_.emplace(device, "mapping", mapping, point_padding, with_gradients);
    const uint64_t width = spec_.sdf.width, half = width * spec_.sdf.sine_layers;
    for (uint64_t l = 0; l < spec_.sdf.sine_layers; ++l) {
      sdf_parameters[l].first = mapping_tape_->output().slice.elements(l * width, width);
      sdf_parameters[l].shift = mapping_tape_->output().slice.elements(half + l * width, width);
      if (!with_gradients) continue;
      sdf_gradients[l].first = mapping_tape_->output_gradient().slice.elements(l * width, width);
      sdf_gradients[l].shift = mapping_tape_->output_gradient().slice.elements(half + l * width, width);
    }
  }
  sdf_.emplace(device, "sdf", siren, sdf_parameters, sdf_gradients);
  if (spec_.skinning.kind == Skinning::backward) pose_ = Buffer(device, "rotations of the joints", pose_inputs(tree_.joints()) * 4ull, BufferPlace::device);
  if (spec_.skinning.learned()) dense(skinning_, "skinning", skinning_shape(), "v", "g");
  dense(color_, "color", color_shape(), "v", "g");
}

BufferSlice AvatarNetworks::slice_of(Buffer& buffer, const std::string& slot) {
  const TensorSlot& tensor = layout_.slot(slot);
  return buffer.slice().elements(tensor.offset, tensor.count);
}

// With the zeros after it, up to the next tensor: whole texels and tiles.
BufferSlice AvatarNetworks::padded_slice_of(Buffer& buffer, const std::string& slot) {
  const TensorSlot& tensor = layout_.slot(slot);
  return buffer.slice().elements(tensor.offset, (tensor.count + kSlotAlignment - 1) / kSlotAlignment * kSlotAlignment);
}

PoseNetworksTensors AvatarNetworks::pose_tensors(Buffer& buffer) {
  const auto slice = [&](const std::string& slot) { return padded_slice_of(buffer, slot); };
  PoseNetworksTensors tensors;
  const ParameterGroup& encoder = layout_.group("pose_code");
  tensors.encoder = buffer.slice().elements(encoder.begin, encoder.size());
  for (uint32_t i = 0; i < spec_.sdf.pose_hidden_layers; ++i) {
    const std::string name = "hyper." + std::to_string(i) + ".";
    tensors.hidden.push_back({slice(name + "W"), slice(name + "b"), slice(name + "scale"), slice(name + "shift")});
  }
  for (uint32_t l = 0; l <= spec_.sdf.sine_layers; ++l) {
    const std::string number = std::to_string(l);
    PoseNetworksTensors::Change change;
    change.base_w = slice("sdf." + number + ".W");
    change.base_b = slice("sdf." + number + ".b");
    if (spec_.sdf.pose == PoseConditioning::low_rank) {
      const std::string name = "low_rank." + number + ".";
      change.low_rank = {slice(name + "U"), slice(name + "V"), slice(name + "C")};
    } else if (&buffer == &parameters_) {  // of these there are no gradients
      change.dense_w = slice("hyper_last." + number + ".W");
      change.dense_b = slice("hyper_last." + number + ".b");
    }
    tensors.layers.push_back(change);
  }
  return tensors;
}

LayerTensors AvatarNetworks::tensors(Buffer& buffer, const std::string& prefix, const char* weight, const char* first) {
  LayerTensors t;
  t.weight = slice_of(buffer, prefix + "." + weight);
  t.bias = slice_of(buffer, prefix + ".b");
  if (*first) t.first = slice_of(buffer, prefix + "." + first);
  return t;
}

void AvatarNetworks::make_half_weights(Device& device) {
  sdf_->make_half_weights(device);
  color_->make_half_weights(device);
}

void AvatarNetworks::record_pose(Commands& commands, const BufferSlice& joint_rotations) {
  if (pose_.bytes()) commands.copy(joint_rotations.elements(0, pose_inputs(tree_.joints())), pose_.slice().elements(0, pose_inputs(tree_.joints())));
}

void AvatarNetworks::record_pack(Commands& commands, std::size_t latent_row, std::span<const float> pose) {
  const size_t expected = pose_networks_ ? size_t{kPoseChannels} * pose_networks_->shape().joints() : 0;
  if (!pose.empty() && pose.size() != expected) throw std::invalid_argument("networks for a pose of " + std::to_string(pose.size()) + " numbers, " + std::to_string(expected) + " expected");
  if (pose_networks_ && pose.empty()) pose_networks_->record_shared(commands);
  if (!pose.empty()) {
    commands.device().upload(pose_networks_->pose().elements(0, pose.size()), pose.data(), pose.size_bytes());
    pose_networks_->record_forward(commands);
  }
  if (spec_.latent_size) {
    const BufferSlice rows = parameter("latent");
    commands.copy(rows.elements(latent_row * spec_.latent_size, spec_.latent_size), code_.slice().elements(0, spec_.latent_size));
    if (mapping_) {
      commands.copy(code_.slice().elements(0, spec_.latent_size), mapping_tape_->input().slice.elements(0, spec_.latent_size));
      mapping_->record_pack(commands);
      mapping_->record_forward(commands, *mapping_tape_, {1, {}});
    }
  }
  sdf_->record_pack(commands);
  if (skinning_) skinning_->record_pack(commands, pose_.bytes() ? pose_.slice() : BufferSlice{});
  color_->record_pack(commands, code());
}

void AvatarNetworks::record_unpack(Commands& commands, std::size_t latent_row, const Parts& parts, const BufferSlice& scratch, uint32_t frame, const PoseRegulariser& pose_regulariser) {
  if (!has_gradients()) throw std::logic_error("these networks were made without gradients");
  if (spec_.latent_size) commands.fill(code_gradient_.slice(), 0);
  if (parts.sdf) {
    if (mapping_) commands.fill(mapping_tape_->output_gradient().slice, 0);
    if (pose_networks_) pose_networks_->record_clear_gradient(commands);
    sdf_->record_unpack(commands);
    if (pose_networks_) {
      if (pose_regulariser.weight > 0) pose_networks_->record_parameter_norm(commands, pose_regulariser.weight, pose_regulariser.losses, pose_regulariser.slot);
      pose_networks_->record_backward(commands, frame);
    }
    if (mapping_) {
      DenseNetwork::Backward backward;
      backward.input_gradient = true;
      backward.scratch = scratch;
      mapping_->record_backward(commands, *mapping_tape_, {1, {}}, backward);
      mapping_->record_unpack(commands);
      commands.copy(mapping_tape_->input_gradient().slice.elements(0, spec_.latent_size), code_gradient_.slice().elements(0, spec_.latent_size));
    }
  }
  if (parts.skinning && skinning_) skinning_->record_unpack(commands, pose_.bytes() ? pose_.slice() : BufferSlice{});
  if (parts.color) color_->record_unpack(commands, code(), code_gradient());
  if (spec_.latent_size)
    commands.copy(code_gradient_.slice().elements(0, spec_.latent_size), gradient("latent").elements(latent_row * spec_.latent_size, spec_.latent_size));
}

std::vector<BufferSlice> AvatarNetworks::effective_gradients(const Parts& parts) {
  std::vector<BufferSlice> all;
  const auto add = [&](auto& network) {
    for (const BufferSlice& layer : network.effective_gradients()) all.push_back(layer);
  };
  if (parts.sdf) add(*sdf_);
  if (parts.skinning && skinning_) add(*skinning_);
  if (parts.color) add(*color_);
  return all;
}

void AvatarNetworks::record_pack_shared_sdf(Commands& commands) {
  if (pose_networks_) pose_networks_->record_shared(commands);
  sdf_->record_pack(commands);
}

void AvatarNetworks::record_unpack_shared_sdf(Commands& commands) {
  if (pose_networks_) pose_networks_->record_clear_gradient(commands);
  sdf_->record_unpack(commands);
  if (pose_networks_) pose_networks_->record_shared_backward(commands);
}

std::vector<AvatarNetworks::LastGradient> AvatarNetworks::hyper_last_gradients(uint32_t frames) {
  std::vector<LastGradient> all;
  for (uint32_t l = 0; l <= spec_.sdf.sine_layers; ++l) {
    const std::string name = "hyper_last." + std::to_string(l);
    all.push_back({layout_.slot(name + ".W"), pose_networks_->dense_w_gradient(l, frames)});
    all.push_back({layout_.slot(name + ".b"), pose_networks_->dense_b_gradient(l, frames)});
  }
  return all;
}

std::vector<float> AvatarNetworks::download_pose_gradient(Device& device) {
  if (!pose_networks_) return {};
  return device.download<float>(pose_networks_->pose_gradient().elements(0, kPoseChannels * pose_networks_->shape().joints()));
}

uint64_t AvatarNetworks::unpack_scratch() const { return mapping_ ? mapping_->weight_gradient_scratch(1) : 64; }

}  // namespace arah
