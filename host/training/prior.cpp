#include "host/training/prior.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <span>

#include "host/body/json_fields.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr const char* kPriorKey = "arah_prior";
constexpr const char* kPriorFormat = "1";

const std::string& prior_text(const SafetensorsFile& file, const char* key) {
  const auto found = file.metadata.find(key);
  if (found == file.metadata.end()) throw InputError(file.path.string(), std::string("metadata ") + key, "this field", "none");
  return found->second;
}

bool of_pose_networks(const TensorSlot& slot) {
  return std::ranges::any_of(std::array{"pose_code.", "hyper.", "low_rank.", "hyper_last."}, [&](const char* group) { return slot.name.starts_with(group); });
}

// x ↦ scale x + shift, from the avatar's cube to the prior's.
struct CubeChange {
  double scale = 1;
  glm::dvec3 shift{0.0};
};

CubeChange to_the_places(const std::vector<glm::dvec3>& from, const std::vector<glm::dvec3>& to) {
  glm::dvec3 from_mean(0.0), to_mean(0.0);
  for (std::size_t j = 0; j < from.size(); ++j) from_mean += from[j] / double(from.size()), to_mean += to[j] / double(from.size());
  double product = 0, square = 0;
  for (std::size_t j = 0; j < from.size(); ++j) {
    product += glm::dot(from[j] - from_mean, to[j] - to_mean);
    square += glm::dot(from[j] - from_mean, from[j] - from_mean);
  }
  CubeChange change;
  if (square > 0 && product > 0) change.scale = product / square;  // one joint alone says nothing of size
  change.shift = to_mean - change.scale * from_mean;
  return change;
}

void scale_all(std::span<float> values, double factor) {
  for (float& value : values) value = static_cast<float>(factor * double{value});
}

// The layer that reads the change instead of the place itself: W (s x + t) + b. weight: [outputs][3], of the outputs' rows `stride`
// numbers of the bias belong to each: columns of the pose networks.
void read_through(const CubeChange& change, std::span<const float> weight, std::span<float> bias, std::size_t stride = 1) {
  for (std::size_t i = 0; i < bias.size(); ++i) {
    const std::size_t row = i / stride, column = i % stride;
    double sum = double{bias[i]};
    for (std::size_t axis = 0; axis < 3; ++axis) sum += double{weight[(row * 3 + axis) * stride + column]} * change.shift[static_cast<int>(axis)];
    bias[i] = static_cast<float>(sum);
  }
}

// The pose encoder reads the joints' rest places p in the cube, and bones' lengths (kernels/reference/pose_encoder.h): s p + t,
// and s times the length, but of the root |p|.
void read_joints_through(Avatar& avatar, const CubeChange& change) {
  const std::size_t joints = avatar.body.skeleton.size(), all = kPoseChannels * joints, hidden = kPoseHidden;
  const auto w = avatar.tensor("pose_code.global.W"), b = avatar.tensor("pose_code.global.b"), w1 = avatar.tensor("pose_code.1.W"), b1 = avatar.tensor("pose_code.1.b");
  for (std::size_t row = 0; row < b.size(); ++row) {
    double sum = double{b[row]};
    for (std::size_t i = 0; i < 3 * joints; ++i) sum += double{w[row * all + 9 * joints + i]} * change.shift[static_cast<int>(i % 3)];
    b[row] = static_cast<float>(sum);
    scale_all(w.subspan(row * all + 9 * joints, 3 * joints), change.scale);
  }
  const glm::dvec3 root = avatar.cube.to_cube(avatar.body.skeleton.rest_joints[0]);
  const double beyond_scale = glm::length(change.scale * root + change.shift) - change.scale * glm::length(root);
  for (std::size_t row = 0; row < b1.size(); ++row) {
    const auto place_and_length = w1.subspan(row * hidden + 9, 4);
    double sum = double{b1[row]};
    for (std::size_t axis = 0; axis < 3; ++axis) sum += double{place_and_length[axis]} * change.shift[static_cast<int>(axis)];
    if (row < hidden) sum += double{place_and_length[3]} * beyond_scale;
    b1[row] = static_cast<float>(sum);
    scale_all(place_and_length, change.scale);
  }
}

// The avatar's networks f, which were the prior's, become those of s x + t; distances f(s x + t) / s.
void move_to_cube(Avatar& avatar, const CubeChange& change, bool skins, bool poses) {
  const std::size_t last = avatar.spec.sdf.sine_layers;
  const auto tensor = [&](const char* group, std::size_t layer, const char* name) { return avatar.tensor(fmt::format("{}.{}.{}", group, layer, name)); };
  read_through(change, tensor("sdf", 0, "W"), tensor("sdf", 0, "b"));
  scale_all(tensor("sdf", 0, "W"), change.scale);
  for (const char* name : {"W", "b"}) scale_all(tensor("sdf", last, name), 1 / change.scale);
  if (skins) {
    // Weight norm: W = g v/|v|, so that s W is s g.
    const auto v = tensor("skinning", 0, "v"), g = tensor("skinning", 0, "g");
    std::vector<float> weight(v.begin(), v.end());
    for (std::size_t row = 0; row < g.size(); ++row) {
      const double length = std::sqrt(double{v[3 * row]} * v[3 * row] + double{v[3 * row + 1]} * v[3 * row + 1] + double{v[3 * row + 2]} * v[3 * row + 2]);
      for (std::size_t axis = 0; axis < 3; ++axis) weight[3 * row + axis] = static_cast<float>(double{g[row]} * v[3 * row + axis] / length);
    }
    read_through(change, weight, tensor("skinning", 0, "b"));
    scale_all(g, change.scale);
  }
  if (!poses) return;
  read_joints_through(avatar, change);
  const std::size_t width = avatar.spec.sdf.pose_width;
  if (avatar.spec.sdf.pose == PoseConditioning::hypernetwork) {
    read_through(change, tensor("hyper_last", 0, "W"), tensor("hyper_last", 0, "b"), width);
    scale_all(tensor("hyper_last", 0, "W"), change.scale);
    for (const char* name : {"W", "b"}) scale_all(tensor("hyper_last", last, name), 1 / change.scale);
    return;
  }
  const auto u = tensor("low_rank", 0, "U"), v = tensor("low_rank", 0, "V"), c = tensor("low_rank", 0, "C");
  for (std::size_t i = 0; i < c.size(); ++i) {  // Σ_r h_r u_r (v_r · t) belongs to b
    const float* direction = &v[i % width * 3];
    c[i] = static_cast<float>(double{c[i]} + double{u[i]} * glm::dot(glm::dvec3(direction[0], direction[1], direction[2]), change.shift));
  }
  scale_all(v, change.scale);
  for (const char* name : {"U", "C"}) scale_all(tensor("low_rank", last, name), 1 / change.scale);
}

std::string pose_text(const SdfSpec& sdf) {
  return sdf.pose == PoseConditioning::none ? "none" : fmt::format("{} of width {} with {} hidden layers", to_string(sdf.pose), sdf.pose_width, sdf.pose_hidden_layers);
}

}  // namespace

bool of_prior(const TensorSlot& slot) { return slot.name.starts_with("sdf.") || slot.name.starts_with("skinning.") || of_pose_networks(slot); }

std::vector<glm::dvec3> joint_places(const Avatar& avatar) {
  std::vector<glm::dvec3> places;
  for (std::size_t j = 0; j < avatar.body.skeleton.size(); ++j)
    places.push_back(avatar.cube.to_cube(glm::dvec3(avatar.canonical.rest_to_canonical[j] * glm::dvec4(avatar.body.skeleton.rest_joints[j], 1.0))));
  return places;
}

SafetensorsFile prior_tensors(const Avatar& avatar, const PretrainSettings& settings, const std::string& family, const std::vector<glm::dvec3>& joint_places) {
  check_finite(avatar);
  SafetensorsFile file;
  for (const TensorSlot& slot : avatar.layout.slots)
    if (of_prior(slot)) file.tensors[slot.name] = Tensor::from<float>(slot.shape, avatar.tensor(slot.name));
  const Skeleton& skeleton = avatar.body.skeleton;
  nlohmann::ordered_json places = nlohmann::ordered_json::array();
  for (const glm::dvec3& place : joint_places) places.push_back({place.x, place.y, place.z});
  file.metadata = {{kPriorKey, kPriorFormat},
                   {"version", kVersion},
                   {"spec", spec_to_json(avatar.spec)},
                   {"settings", pretrain_settings_to_json(settings)},
                   {"seed", std::to_string(settings.seed)},
                   {"family", family},
                   {"joints", nlohmann::ordered_json{{"names", skeleton.names}, {"parents", skeleton.parents}, {"places", places}}.dump()}};
  return file;
}

Prior read_prior(const std::filesystem::path& path) {
  Prior prior;
  prior.file = read_safetensors(path);
  const std::string where = path.string();
  const auto format = prior.file.metadata.find(kPriorKey);
  if (format == prior.file.metadata.end()) throw InputError(where, "", "a prior", "a safetensors file of another kind", "'arah pretrain' makes priors.");
  if (format->second != kPriorFormat)
    throw InputError(where, std::string("metadata ") + kPriorKey, std::string("format ") + kPriorFormat, "'" + format->second + "'", "A newer program wrote this file.");
  prior.version = prior_text(prior.file, "version");
  prior.spec = spec_from_json(prior_text(prior.file, "spec"), where + ": spec");
  prior.settings = pretrain_settings_from_json(prior_text(prior.file, "settings"), where + ": settings");
  prior.family = prior_text(prior.file, "family");
  if (!parse_json(prior.family, where, "metadata family").is_object()) throw InputError(where, "metadata family", "an object", "something else");
  const auto joints = parse_json(prior_text(prior.file, "joints"), where, "metadata joints");
  try {
    prior.joint_names = joints.at("names").get<std::vector<std::string>>();
    prior.joint_parents = joints.at("parents").get<std::vector<int>>();
    for (const auto& place : joints.value("places", nlohmann::json::array())) prior.joint_places.emplace_back(place.at(0).get<double>(), place.at(1).get<double>(), place.at(2).get<double>());
  } catch (const nlohmann::json::exception& error) {
    throw InputError(where, "metadata joints", "names and parents", error.what());
  }
  if (prior.joint_names.size() != prior.joint_parents.size())
    throw InputError(where, "metadata joints", "as many parents as names", fmt::format("{} and {}", prior.joint_parents.size(), prior.joint_names.size()));
  if (!prior.joint_places.empty() && prior.joint_places.size() != prior.joint_names.size())
    throw InputError(where, "metadata joints", "as many places as names", fmt::format("{} and {}", prior.joint_places.size(), prior.joint_names.size()));
  return prior;
}

std::string start_from_prior(Avatar& avatar, const Prior& prior) {
  const std::string where = prior.file.path.string();
  const std::string advice = "Train without --prior, or make one for this avatar with arah pretrain.";
  const auto require = [&](const char* field, const auto& expected, const auto& found) {
    if (expected != found) throw InputError(where, field, fmt::format("the avatar's {}", expected), fmt::format("{}", found), advice);
  };
  const SdfSpec &sdf = avatar.spec.sdf, &prior_sdf = prior.spec.sdf;
  require("sdf.width", sdf.width, prior_sdf.width);
  require("sdf.sine_layers", sdf.sine_layers, prior_sdf.sine_layers);
  require("sdf.omega", sdf.omega, prior_sdf.omega);
  const bool skins = avatar.spec.skinning.kind == Skinning::network;
  const Skeleton& skeleton = avatar.body.skeleton;
  require("joints", skeleton.size(), prior.joint_names.size());
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    require(fmt::format("joint {}", j).c_str(), skeleton.names[j], prior.joint_names[j]);
    require(fmt::format("parent of joint {} ('{}')", j, skeleton.names[j]).c_str(), skeleton.parents[j], prior.joint_parents[j]);
  }
  if (skins) {
    require("skinning.kind", std::string(to_string(avatar.spec.skinning.kind)), std::string(to_string(prior.spec.skinning.kind)));
    require("skinning.width", avatar.spec.skinning.width, prior.spec.skinning.width);
    require("skinning.hidden_layers", avatar.spec.skinning.hidden_layers, prior.spec.skinning.hidden_layers);
  }
  const bool poses = sdf.pose != PoseConditioning::none && sdf.pose == prior_sdf.pose && sdf.pose_width == prior_sdf.pose_width && sdf.pose_hidden_layers == prior_sdf.pose_hidden_layers;
  std::vector<std::pair<const TensorSlot*, std::vector<float>>> taken;
  for (const TensorSlot& slot : avatar.layout.slots) {
    if (!slot.name.starts_with("sdf.") && !(skins && slot.name.starts_with("skinning.")) && !(poses && of_pose_networks(slot))) continue;
    taken.emplace_back(&slot, prior.file.values<float>(slot.name, slot.shape));
    for (const float value : taken.back().second)
      if (!std::isfinite(value)) throw InputError(where, fmt::format("tensor \"{}\"", slot.name), "finite numbers", fmt::format("{}", value));
  }
  for (const auto& [slot, values] : taken) std::ranges::copy(values, avatar.tensor(slot->name).begin());
  if (!prior.joint_places.empty()) move_to_cube(avatar, to_the_places(joint_places(avatar), prior.joint_places), skins, poses);
  if (sdf.pose == PoseConditioning::none && prior_sdf.pose == PoseConditioning::none) return {};
  if (poses) return "pose networks from the prior: " + pose_text(sdf);
  return fmt::format("pose networks not from the prior: the avatar's are {}, the prior's {}", pose_text(sdf), pose_text(prior_sdf));
}

}  // namespace arah
