#include "host/training/prior.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

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

std::string pose_text(const SdfSpec& sdf) {
  return sdf.pose == PoseConditioning::none ? "none" : fmt::format("{} of width {} with {} hidden layers", to_string(sdf.pose), sdf.pose_width, sdf.pose_hidden_layers);
}

}  // namespace

bool of_prior(const TensorSlot& slot) { return slot.name.starts_with("sdf.") || slot.name.starts_with("skinning.") || of_pose_networks(slot); }

SafetensorsFile prior_tensors(const Avatar& avatar, const PretrainSettings& settings, const std::string& family) {
  check_finite(avatar);
  SafetensorsFile file;
  for (const TensorSlot& slot : avatar.layout.slots)
    if (of_prior(slot)) file.tensors[slot.name] = Tensor::from<float>(slot.shape, avatar.tensor(slot.name));
  const Skeleton& skeleton = avatar.body.skeleton;
  file.metadata = {{kPriorKey, kPriorFormat},
                   {"version", kVersion},
                   {"spec", spec_to_json(avatar.spec)},
                   {"settings", pretrain_settings_to_json(settings)},
                   {"seed", std::to_string(settings.seed)},
                   {"family", family},
                   {"joints", nlohmann::ordered_json{{"names", skeleton.names}, {"parents", skeleton.parents}}.dump()}};
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
  const auto joints = nlohmann::json::parse(prior_text(prior.file, "joints"), nullptr, false);
  try {
    prior.joint_names = joints.at("names").get<std::vector<std::string>>();
    prior.joint_parents = joints.at("parents").get<std::vector<int>>();
  } catch (const nlohmann::json::exception& error) {
    throw InputError(where, "metadata joints", "names and parents", error.what());
  }
  if (prior.joint_names.size() != prior.joint_parents.size())
    throw InputError(where, "metadata joints", "as many parents as names", fmt::format("{} and {}", prior.joint_parents.size(), prior.joint_names.size()));
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
  if (sdf.pose == PoseConditioning::none && prior_sdf.pose == PoseConditioning::none) return {};
  if (poses) return "pose networks from the prior: " + pose_text(sdf);
  return fmt::format("pose networks not from the prior: the avatar's are {}, the prior's {}", pose_text(sdf), pose_text(prior_sdf));
}

}  // namespace arah
