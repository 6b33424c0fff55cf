#include "host/avatar/avatar_spec.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr uint32_t kMostWidth = 1024;
constexpr uint32_t kMostLayers = 16;
constexpr std::size_t kMostGridLevels = 4;

// One preset's sizes for CPU devices; everything but the widths is common to them.
AvatarSpec small_spec(const std::string& name, uint32_t width, uint32_t skinning_hidden_layers) {
  AvatarSpec spec;
  spec.preset = name;
  spec.skinning = {Skinning::network, 64, skinning_hidden_layers};
  spec.sdf.width = width;
  spec.sdf.sine_layers = 4;
  spec.color.width = width;
  spec.color.hidden_layers = 3;
  spec.color.latent = true;
  spec.latent_size = 16;
  spec.grid_cells = {0.04, 0.02};
  return spec;
}

AvatarSpec paper_spec() {
  AvatarSpec spec;
  spec.preset = "paper";
  spec.skinning = {Skinning::network, 128, 4};
  spec.sdf = {256, 6, 30.0, SdfConditioning::latent, 256, 3, PoseConditioning::hypernetwork, 256, 2};
  spec.color = {256, 5, 3, 128, true, true, true, true};
  spec.latent_size = 128;
  spec.latent_init_std = 1.0;
  spec.b_init = 1e-3;
  return spec;
}

}  // namespace

const std::vector<std::string>& preset_names() {
  static const std::vector<std::string> names{"tiny", "compact", "paper"};
  return names;
}

AvatarSpec preset_spec(const std::string& name) {
  if (name == "tiny") return small_spec(name, 64, 2);
  if (name == "compact") return small_spec(name, 128, 3);
  if (name == "paper") return paper_spec();
  throw InputError("preset", "", fmt::format("one of {}", fmt::join(preset_names(), ", ")), "'" + name + "'");
}

void validate_spec(const AvatarSpec& spec, const std::string& where) {
  const auto in_range = [&](const char* field, int64_t value, int64_t least, int64_t most) {
    if (value < least || value > most) {
      throw InputError(where, field, fmt::format("a whole number from {} to {}", least, most),
                       fmt::format("{}", value));
    }
  };
  const auto sized = [&](bool present, const char* part, const char* field, uint32_t value, uint32_t most) {
    if (present) return in_range(field, value, 1, most);
    if (value != 0) throw InputError(where, field, fmt::format("0 without {}", part), fmt::format("{}", value));
  };
  const auto positive = [&](const char* field, double value, bool zero_too) {
    if (!(std::isfinite(value) && (value > 0 || (zero_too && value == 0)))) {
      throw InputError(where, field, zero_too ? "a number of at least 0" : "a number above 0",
                       fmt::format("{}", value));
    }
  };
  const auto is_word = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  };
  if (!std::all_of(spec.preset.begin(), spec.preset.end(), is_word)) {
    throw InputError(where, "preset", "letters, digits and _", "'" + spec.preset + "'");
  }

  const bool network = spec.skinning.learned();
  sized(network, "a skinning network", "skinning.width", spec.skinning.width, kMostWidth);
  sized(network, "a skinning network", "skinning.hidden_layers", spec.skinning.hidden_layers, kMostLayers);

  in_range("sdf.width", spec.sdf.width, 1, kMostWidth);
  in_range("sdf.sine_layers", spec.sdf.sine_layers, 1, kMostLayers);
  positive("sdf.omega", spec.sdf.omega, false);
  const bool conditioned = spec.sdf.conditioning == SdfConditioning::latent;
  sized(conditioned, "conditioning", "sdf.mapping_width", spec.sdf.mapping_width, kMostWidth);
  sized(conditioned, "conditioning", "sdf.mapping_hidden_layers", spec.sdf.mapping_hidden_layers, kMostLayers);
  const bool posed = spec.sdf.pose != PoseConditioning::none;
  sized(posed, "sdf.pose", "sdf.pose_width", spec.sdf.pose_width, kMostWidth);
  sized(posed, "sdf.pose", "sdf.pose_hidden_layers", spec.sdf.pose_hidden_layers, kMostLayers);
  if (spec.sdf.pose_width % 8 != 0) {
    throw InputError(where, "sdf.pose_width", "a multiple of 8", fmt::format("{}", spec.sdf.pose_width));
  }

  in_range("color.width", spec.color.width, 1, kMostWidth);
  in_range("color.hidden_layers", spec.color.hidden_layers, 1, kMostLayers);
  if (spec.color.skip != -1) in_range("color.skip", spec.color.skip, 1, spec.color.hidden_layers);
  sized(spec.color.skip != -1, "a skip", "color.narrow", spec.color.narrow, kMostWidth);

  if (spec.color.directions != DirectionSpace::observation && !spec.color.view && !spec.color.normal) {
    throw InputError(where, "color.directions", "observation without color.view and color.normal",
                     to_string(spec.color.directions));
  }

  const bool latent_read = conditioned || spec.color.latent;
  sized(latent_read, "a reader (sdf.conditioning or color.latent)", "latent_size", spec.latent_size, kMostWidth);
  positive("latent_init_std", spec.latent_init_std, true);
  // What the density clips b to; beyond it b's gradient is 0 and it would stay there.
  if (!(spec.b_init >= 1e-6 && spec.b_init <= 1e6)) throw InputError(where, "b_init", "metres, from 1e-6 to 1e6", fmt::format("{}", spec.b_init));
  if (spec.grid_cells.size() > kMostGridLevels) {
    throw InputError(where, "grid_cells", fmt::format("at most {} levels", kMostGridLevels),
                     fmt::format("{}", spec.grid_cells.size()));
  }
  for (double cell : spec.grid_cells) positive("grid_cells", cell, false);
}

const char* to_string(Skinning skinning) {
  switch (skinning) {
    case Skinning::none:
      return "none";
    case Skinning::template_weights:
      return "template_weights";
    case Skinning::network:
      return "network";
    case Skinning::backward:
      return "backward";
  }
  return "unknown";
}

const char* to_string(SdfConditioning conditioning) {
  return conditioning == SdfConditioning::none ? "none" : "latent";
}

const char* to_string(PoseConditioning pose) {
  switch (pose) {
    case PoseConditioning::none:
      return "none";
    case PoseConditioning::low_rank:
      return "low_rank";
    case PoseConditioning::hypernetwork:
      return "hypernetwork";
  }
  return "unknown";
}

const char* to_string(DirectionSpace space) {
  return space == DirectionSpace::observation ? "observation" : "canonical";
}

const char* to_string(FieldKind kind) {
  return kind == FieldKind::sdf ? "sdf" : "density";
}

void require_surface(const AvatarSpec& spec, const std::string& what) {
  if (spec.skinning.kind == Skinning::backward) {
    throw InputError(what, "", "an avatar whose skinning leads to posed space", "one with skinning.kind backward",
                     "It is sampled in the shell (sampling_mode=shell).");
  }
  if (spec.sdf.kind == FieldKind::sdf) return;
  throw InputError(what, "", "an avatar with a surface (sdf.kind sdf)", "one with sdf.kind density",
                   "A density is sampled in the shell (sampling_mode=shell) and asked itself (distances=network).");
}

std::vector<uint32_t> sdf_widths(const AvatarSpec& spec) {
  std::vector<uint32_t> widths(spec.sdf.sine_layers + 2, spec.sdf.width);
  widths.front() = 3;
  widths.back() = 1;
  return widths;
}

std::vector<uint32_t> mapping_widths(const AvatarSpec& spec) {
  if (spec.sdf.conditioning == SdfConditioning::none) return {};
  std::vector<uint32_t> widths(spec.sdf.mapping_hidden_layers + 2, spec.sdf.mapping_width);
  widths.front() = spec.latent_size;
  widths.back() = 2 * spec.sdf.sine_layers * spec.sdf.width;
  return widths;
}

std::vector<uint32_t> pose_widths(const AvatarSpec& spec, uint32_t joints) {
  if (spec.sdf.pose == PoseConditioning::none) return {};
  std::vector<uint32_t> widths(spec.sdf.pose_hidden_layers + 1, spec.sdf.pose_width);
  widths.front() = kPoseFeatures * joints;
  return widths;
}

std::vector<uint32_t> skinning_widths(const AvatarSpec& spec, uint32_t logits, uint32_t joints) {
  if (!spec.skinning.learned()) return {};
  std::vector<uint32_t> widths(spec.skinning.hidden_layers + 2, spec.skinning.width);
  widths.front() = 3 + (spec.skinning.kind == Skinning::backward ? pose_inputs(joints) : 0);
  widths.back() = logits;
  return widths;
}

std::vector<uint32_t> color_widths(const AvatarSpec& spec) {
  const ColorSpec& color = spec.color;
  std::vector<uint32_t> widths(color.hidden_layers + 2, color.width);
  widths.front() =
      3 + (color.view ? kViewChannels : 0) + (color.normal ? 3 : 0) + (color.feature ? spec.sdf.width : 0) +
      kGridFeatures * static_cast<uint32_t>(spec.grid_cells.size()) + (color.latent ? spec.latent_size : 0);
  widths.back() = 3;
  // Layer `skip` reads widths[skip], which is what the layer before it wrote.
  if (color.skip != -1) widths[static_cast<std::size_t>(color.skip)] = color.narrow;
  return widths;
}

}  // namespace arah
