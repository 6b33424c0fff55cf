// What of an avatar is modelled, and in which sizes: plain data with a JSON form. A part that is absent costs nothing:
// no parameters, no pipelines, no dispatches. Sources of the sizes: ARAH.md sections 1 to 3 for the preset `paper`.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace arah {

// none: the body never moves. The canonical pose is the one pose of the capture (Avatar::canonical).
// template_weights: a point follows the weights of the template's nearest vertex.
// network: weight-normalised layers with softplus(100), logits times 20, hierarchical softmax (ARAH.md section 2).
// backward: the ablation that learns the inverse instead of searching it: a network of the same kind, but of posed points (in the
// axes of the posed root joint) and of the rotations of all other joints, gives the weights whose blend is inverted (paper, App.
// "Ablation on Learned forward LBS"). It knows no way from canonical to posed space: no surface is searched or meshed.
enum class Skinning { none, template_weights, network, backward };

struct SkinningSpec {
  Skinning kind = Skinning::network;
  uint32_t width = 0;          // of the hidden layers, 1..1024; 0 unless learned()
  uint32_t hidden_layers = 0;  // 1..16: one fewer than linear layers; 0 unless learned()

  bool learned() const { return kind == Skinning::network || kind == Skinning::backward; }

  bool operator==(const SkinningSpec&) const = default;
};

// none: one SDF for all frames. latent: a frame's code sets the FiLM scales and shifts of the sine layers through a
// mapping network (ARAH.md section 1).
enum class SdfConditioning { none, latent };

// How the SDF follows the body's pose (ARAH.md section 1; kernels/conditioning/pose_networks.h). none: not at all.
// low_rank: each layer's matrix changes by outer products whose factors the pose sets. hypernetwork: the paper's, which
// makes every number of the SDF from the pose.
enum class PoseConditioning { none, low_rank, hypernetwork };
// What the canonical field's values are. sdf: signed distances, whose density is Laplace's (ARAH.md section 6).
// density: a canonical radiance field instead, the ablation: a raw density, σ = softplus(−f/b) / b with f in metres
// (kernels/reference/density.h). It begins as the template's distances too, but has no surface and no terms that keep one: it is
// sampled in the template's shell, and neither meshed nor baked.
enum class FieldKind { sdf, density };

struct SdfSpec {
  uint32_t width = 64;       // of the sine layers, and of the feature that the colour network may read, 1..1024
  uint32_t sine_layers = 4;  // 1..16; a linear layer to one number follows
  double omega = 30.0;       // factor of every sine's argument, > 0
  SdfConditioning conditioning = SdfConditioning::none;
  uint32_t mapping_width = 0;          // hidden width of the mapping network, 1..1024; 0 without conditioning
  uint32_t mapping_hidden_layers = 0;  // 1..16; 0 without conditioning
  PoseConditioning pose = PoseConditioning::none;
  uint32_t pose_width = 0;          // of the hypernetwork's hidden layers; the rank. A multiple of 8 to 1024; 0 without pose
  uint32_t pose_hidden_layers = 0;  // 1..16; 0 without pose
  FieldKind kind = FieldKind::sdf;

  bool operator==(const SdfSpec&) const = default;
};

// Which axes the view direction v and the normal ∇f go into the colour network in. observation: the world's, v and T(x̂) ∇f.
// canonical: those of the canonical pose, T(x̂)⁻¹ v and ∇f (ARAH.md section 1, "Normal", and section 3). T(x̂) is the 3 × 3
// part of the blended bone transforms.
enum class DirectionSpace { observation, canonical };

// The network's input is [n(x) 3, view 27, normal 3, SDF feature, grid 4 a level, latent], each part if it is on.
struct ColorSpec {
  uint32_t width = 64;         // of the hidden layers, 1..1024
  uint32_t hidden_layers = 3;  // 1..16: one fewer than linear layers
  int32_t skip = -1;           // the linear layer that reads [input, previous output], 1..hidden_layers; -1: none
  uint32_t narrow = 0;         // width of the layer before the skip, 1..1024; 0 without a skip
  bool view = false;           // towards the camera, with the sines and cosines of 1, 2, 4 and 8 times it
  bool normal = false;         // the SDF's gradient, not of unit length
  bool feature = true;         // the last sine layer's activations
  bool latent = false;         // the frame's code
  DirectionSpace directions = DirectionSpace::observation;  // of view and normal; observation where both are off

  bool operator==(const ColorSpec&) const = default;
};

struct AvatarSpec {
  std::string preset;  // the preset that the sizes came from, for reports; a word of letters, digits and _
  SkinningSpec skinning;
  SdfSpec sdf;
  ColorSpec color;
  uint32_t latent_size = 0;      // numbers a frame, 1..1024; 0 where nothing reads a code
  double latent_init_std = 0.1;  // of the codes' normal initial values, >= 0
  double b_init = 5e-3;          // first value of b, the scale of the density, metres, 1e-6 to 1e6
  std::vector<double>
      grid_cells;  // metres, one a level of the colour's feature grid, at most 4, each > 0; empty: no grid

  bool operator==(const AvatarSpec&) const = default;
};

// Features that a node of the grid holds, and channels of the encoded view direction.
inline constexpr uint32_t kGridFeatures = 4;
inline constexpr uint32_t kViewChannels = 27;
// The pose encoder's numbers of a joint: input (R 9, J 3), output, and hidden (the input, its bone's length, its parent's).
inline constexpr uint32_t kPoseChannels = 12;
inline constexpr uint32_t kPoseFeatures = 6;
inline constexpr uint32_t kPoseHidden = kPoseChannels + 1 + kPoseFeatures;

// "tiny" (minutes on two CPU cores), "compact" (half an hour) or "paper" (the released sizes, conditioned on the latent
// code and on the pose). Throws InputError naming the presets for any other name.
AvatarSpec preset_spec(const std::string& name);
const std::vector<std::string>& preset_names();

// Throws InputError naming `where` and the field whose value is out of range or contradicts another: a latent size that
// nothing reads, a conditioning or colour latent without a size, sizes of a part that is absent.
void validate_spec(const AvatarSpec& spec, const std::string& where);

// Every field by name; numbers read back exactly.
std::string spec_to_json(const AvatarSpec& spec);

// The other way. Every field must be there and none else; those that came later (color.directions, sdf.kind, sdf.pose and its
// sizes) may be absent and are then observation, sdf and none. Throws InputError naming `where` and the field: no JSON,
// unknown or missing fields, a wrong type, and what validate_spec refuses.
AvatarSpec spec_from_json(const std::string& text, const std::string& where);

// `base` with the fields that the text states, for example {"sdf": {"width": 96}}. Throws as spec_from_json does, but
// absent fields keep their value.
AvatarSpec spec_with_json(const AvatarSpec& base, const std::string& text, const std::string& where);

const char* to_string(Skinning skinning);
const char* to_string(SdfConditioning conditioning);
const char* to_string(PoseConditioning pose);
const char* to_string(DirectionSpace space);
const char* to_string(FieldKind kind);

// Throws InputError where `what` was asked for, which needs a surface, and the avatar has a density
// instead, or skinning that does not lead to posed space.
void require_surface(const AvatarSpec& spec, const std::string& what);

// Widths of each network from its input to its output, w_0 → w_1 → … → w_n for n linear layers; empty where the network
// is absent. With a skip the layer's input is [input, previous output], which these widths do not count.
std::vector<uint32_t> sdf_widths(const AvatarSpec& spec);  // 3 → width … → 1
std::vector<uint32_t> mapping_widths(
    const AvatarSpec& spec);  // latent → … → 2 · sine layers · width: all γ, then all η
// joints: of the body; of each of the small networks, one a layer of the SDF: 6 · joints → pose width …
std::vector<uint32_t> pose_widths(const AvatarSpec& spec, uint32_t joints);
// 3 → width … → logits; with Skinning::backward 3 and the rotations of all joints but the first, 9 numbers each
std::vector<uint32_t> skinning_widths(const AvatarSpec& spec, uint32_t logits, uint32_t joints);
constexpr uint32_t pose_inputs(uint32_t joints) { return 9 * (joints - 1); }
std::vector<uint32_t> color_widths(const AvatarSpec& spec);                      // input → width … → 3

}  // namespace arah
