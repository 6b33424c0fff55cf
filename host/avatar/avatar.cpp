#include "host/avatar/avatar.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "host/avatar/spec_choice.h"
#include "host/input_error.h"

namespace arah {
namespace {

// "12,345,678"
std::string grouped(uint64_t number) {
  const std::string digits = std::to_string(number);
  std::string text;
  for (std::size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0) text.push_back(',');
    text.push_back(digits[i]);
  }
  return text;
}

// " 3-64-64-1"; empty for an absent network.
std::string sizes_text(const std::vector<uint32_t>& widths) {
  return widths.empty() ? std::string() : fmt::format(" {}", fmt::join(widths, "-"));
}

// "[2, 0, 5]" of a flat row-major index.
std::string index_text(uint64_t flat, const std::vector<int64_t>& shape) {
  std::vector<uint64_t> index(shape.size());
  for (std::size_t axis = shape.size(); axis-- > 0;) {
    index[axis] = flat % static_cast<uint64_t>(shape[axis]);
    flat /= static_cast<uint64_t>(shape[axis]);
  }
  return fmt::format("[{}]", fmt::join(index, ", "));
}

}  // namespace

std::span<float> Avatar::tensor(const std::string& name) {
  const TensorSlot& slot = layout.slot(name);
  return std::span(parameters).subspan(slot.offset, slot.count);
}

std::span<const float> Avatar::tensor(const std::string& name) const {
  const TensorSlot& slot = layout.slot(name);
  return std::span(parameters).subspan(slot.offset, slot.count);
}

double density_scale(const Avatar& avatar) { return std::clamp(std::abs(double{avatar.tensor("b")[0]}), 1e-6, 1e6); }

void check_extent(const CubeNormalization& cube, const std::string& where) {
  const double extent = cube.cmax - cube.cmin;
  if (extent >= kLeastExtent && extent <= kLargestExtent) return;
  std::string advice = "Its lengths must be in metres: scale them, and with them T of cameras and root positions of motions.";
  for (const auto& [unit, metres] : {std::pair{"millimetres", 1e-3}, std::pair{"centimetres", 1e-2}, std::pair{"inches", 0.0254}, std::pair{"kilometres", 1e3}})
    if (const double size = extent * metres; size > 0.8 && size < 2.5) {  // a person, arms and legs spread
      advice = fmt::format("Its lengths seem to be in {}: multiply them by {:g}, and with them T of cameras and root positions of motions where they are in {} too.", unit, metres, unit);
      break;
    }
  throw InputError(where, "vertices", fmt::format("a body of {} to {} m", kLeastExtent, kLargestExtent), fmt::format("one of {:.3g} m", extent), advice);
}

namespace {

// where: the body's file.
Avatar avatar_of_body(const AvatarSpec& spec, BodyTemplate body, std::vector<int> latent_frames, uint64_t seed, const Pose* only_pose, const std::string& where) {
  validate_spec(spec, "avatar");
  if (std::set<int>(latent_frames.begin(), latent_frames.end()).size() != latent_frames.size()) {
    throw std::invalid_argument("latent frames must be distinct");
  }
  Avatar avatar;
  avatar.spec = spec;
  avatar.seed = seed;
  avatar.body = body.glb.empty() ? read_body_template_bytes(body_template_glb(body), "template") : std::move(body);
  const Skeleton& skeleton = avatar.body.skeleton;
  if (spec.skinning.kind == Skinning::none) {
    if (only_pose == nullptr) throw std::invalid_argument("an avatar without skinning needs the one pose that it has");
    avatar.canonical = {rest_to_posed(skeleton, *only_pose)};
  } else {
    avatar.canonical = make_canonical_pose(skeleton);
  }
  const std::vector<glm::dvec3> vertices = canonical_vertices(avatar.body, avatar.canonical);
  avatar.cube = cube_normalization(vertices);
  check_extent(avatar.cube, where);
  avatar.grid = make_grid_extent(spec, vertices);
  if (spec.latent_size > 0) avatar.latent_frames = std::move(latent_frames);
  avatar.layout = make_parameter_layout(spec, skeleton, avatar.latent_frames.size(), avatar.grid);
  avatar.parameters = initial_parameters(spec, avatar.layout, seed);
  return avatar;
}

}  // namespace

Avatar make_avatar(const AvatarSpec& spec, BodyTemplate body, std::vector<int> latent_frames, uint64_t seed, const Pose* only_pose) {
  return avatar_of_body(spec, std::move(body), std::move(latent_frames), seed, only_pose, "template");
}

Avatar make_avatar(const AvatarSpec& spec, const Capture& capture, uint64_t seed) {
  const std::vector<int> frames = training_frames(capture);
  const Pose& first = find_frame(motion_of(capture, "train"), frames.front())->pose;
  return avatar_of_body(spec, capture.body_template, frames, seed, &first, (capture.path / "template.glb").string());
}

std::size_t latent_row(const Avatar& avatar, int frame) {
  const std::vector<int>& frames = avatar.latent_frames;
  if (frames.empty()) throw std::out_of_range("the avatar has no latent codes");
  const auto found = std::find(frames.begin(), frames.end(), frame);
  return found == frames.end() ? frames.size() - 1 : static_cast<std::size_t>(found - frames.begin());
}

std::vector<float> pose_input(const Avatar& avatar, const Pose& pose) {
  if (avatar.spec.sdf.pose == PoseConditioning::none) return {};
  const Skeleton& skeleton = avatar.body.skeleton;
  if (pose.theta.size() != skeleton.size()) throw std::invalid_argument("a pose with another number of joints than the avatar's body");
  std::vector<float> input{1, 0, 0, 0, 1, 0, 0, 0, 1};
  const std::vector<float> rotations = joint_rotations(pose);
  input.insert(input.end(), rotations.begin(), rotations.end());
  for (const glm::dvec3& joint : skeleton.rest_joints) {
    const glm::dvec3 n = avatar.cube.to_cube(joint);
    for (int axis = 0; axis < 3; ++axis) input.push_back(static_cast<float>(n[axis]));
  }
  return input;
}

void check_finite(const Avatar& avatar) {
  for (const TensorSlot& slot : avatar.layout.slots) {
    const std::span<const float> values = avatar.tensor(slot.name);
    const auto bad = std::find_if(values.begin(), values.end(), [](float value) { return !std::isfinite(value); });
    if (bad == values.end()) continue;
    throw std::runtime_error(fmt::format("tensor \"{}\": element {} is {}, expected finite numbers", slot.name,
                                         index_text(static_cast<uint64_t>(bad - values.begin()), slot.shape), *bad));
  }
}

std::string describe(const Avatar& avatar) {
  const AvatarSpec& spec = avatar.spec;
  const uint32_t logits = skinning_logit_count(avatar.body.skeleton);
  std::vector<std::string> lines;
  const auto say = [&]<typename... Args>(fmt::format_string<Args...> format, Args&&... args) {
    lines.push_back(fmt::format(format, std::forward<Args>(args)...));
  };
  say("avatar: preset {}, {} steps trained, seed {}, written by version {}", spec.preset.empty() ? "none" : spec.preset,
      avatar.steps, avatar.seed, avatar.version);
  say("  body: {} vertices, {} triangles, {} joints", avatar.body.vertices.size(), avatar.body.triangles.size(),
      avatar.body.skeleton.size());
  say("  canonical cube: center ({:.3f}, {:.3f}, {:.3f}) m, {:.4f} m to a unit", avatar.cube.center.x,
      avatar.cube.center.y, avatar.cube.center.z, avatar.cube.metres_per_unit());
  say("  skinning: {}{}", to_string(spec.skinning.kind), sizes_text(skinning_widths(spec, logits, static_cast<uint32_t>(avatar.body.skeleton.size()))));
  say("  {}:{} (sine, omega {}), conditioning {}{}", spec.sdf.kind == FieldKind::sdf ? "SDF" : "density", sizes_text(sdf_widths(spec)), spec.sdf.omega,
      to_string(spec.sdf.conditioning), sizes_text(mapping_widths(spec)));
  if (spec.sdf.pose != PoseConditioning::none) {
    say("  SDF by pose: {}{} a layer", to_string(spec.sdf.pose),
        sizes_text(pose_widths(spec, static_cast<uint32_t>(avatar.body.skeleton.size()))));
  }
  std::vector<std::string> inputs{"position"};
  const char* canonical = spec.color.directions == DirectionSpace::canonical ? "canonical " : "";
  if (spec.color.view) inputs.push_back(fmt::format("{}view", canonical));
  if (spec.color.normal) inputs.push_back(fmt::format("{}normal", canonical));
  if (spec.color.feature) inputs.push_back("SDF feature");
  if (!spec.grid_cells.empty()) inputs.push_back("grid");
  if (spec.color.latent) inputs.push_back("latent");
  say("  colour:{}{}; reads {}", sizes_text(color_widths(spec)),
      spec.color.skip < 0 ? "" : fmt::format(", input again before layer {}", spec.color.skip),
      fmt::join(inputs, ", "));
  for (std::size_t i = 0; i < avatar.grid.nodes.size(); ++i) {
    const glm::uvec3& nodes = avatar.grid.nodes[i];
    say("  grid level {}: {} x {} x {} nodes, cells of {} m", i, nodes.x, nodes.y, nodes.z, spec.grid_cells[i]);
  }
  if (!avatar.latent_frames.empty()) {
    say("  latent codes: {} frames ({} to {}), {} numbers each", avatar.latent_frames.size(),
        *std::min_element(avatar.latent_frames.begin(), avatar.latent_frames.end()),
        *std::max_element(avatar.latent_frames.begin(), avatar.latent_frames.end()), spec.latent_size);
  }
  if (!avatar.refined.empty()) say("  refined poses: {} frames", avatar.refined.frames.size());
  const ShapeSpace& shape = avatar.body.shape;
  for (std::size_t b = 0; b < shape.size(); ++b) {
    const bool refined = !avatar.refined.start_shape.empty();
    say("  shape '{}': {:.4g}{}", shape.names[b], shape.beta[b], refined ? fmt::format(", {:.4g} before training", avatar.refined.start_shape[b]) : "");
  }
  say("  density scale b: {:.3g} mm", 1e3 * static_cast<double>(avatar.tensor("b")[0]));
  std::vector<std::string> sizes;
  for (const ParameterGroup& group : avatar.layout.groups) {
    if (group.size() > 0) {
      sizes.push_back(fmt::format("{} {}", group.name, grouped(avatar.layout.parameter_count(group.name))));
    }
  }
  say("  learned numbers: {} ({})", grouped(avatar.layout.parameter_count()), fmt::join(sizes, ", "));
  float largest = 0;
  std::string of;
  for (const TensorSlot& slot : avatar.layout.slots)
    for (const float value : avatar.tensor(slot.name))
      if (std::abs(value) > largest) largest = std::abs(value), of = slot.name;
  say("  largest of them: {:.4g}, in tensor \"{}\"", largest, of);
  return fmt::format("{}\n", fmt::join(lines, "\n"));
}

}  // namespace arah
