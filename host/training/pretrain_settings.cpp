#include "host/training/pretrain_settings.h"

#include <cmath>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "host/body/json_fields.h"
#include "host/input_error.h"

namespace arah {
namespace {

// One list of fields serves both directions: visit(name, value) for each; fields of a network are called "sdf.steps".
template <typename Settings, typename Visit>
void visit_reptile_fields(const std::string& name, Settings& s, const Visit& visit) {
  visit(name, "steps", s.steps);
  visit(name, "tasks", s.tasks);
  visit(name, "inner_steps", s.inner_steps);
  visit(name, "inner_rate", s.inner_rate);
  visit(name, "outer_rate", s.outer_rate);
  visit(name, "end_fraction", s.end_fraction);
}

template <typename Settings, typename Visit>
void visit_pretrain_fields(Settings& s, const Visit& visit) {
  const std::string top;
  visit(top, "preset", s.preset);
  visit(top, "seed", s.seed);
  visit(top, "bodies", s.bodies);
  visit(top, "poses", s.poses);
  visit_reptile_fields("sdf", s.sdf, visit);
  visit_reptile_fields("skinning", s.skinning, visit);
  visit_reptile_fields("pose", s.pose, visit);
  visit(top, "pose_encoder_rate", s.pose_encoder_rate);
  visit(top, "pose_batch", s.pose_batch);
  visit(top, "parameter_weight", s.parameter_weight);
  visit(top, "surface_points", s.surface_points);
  visit(top, "volume_points", s.volume_points);
  visit(top, "surface_weight", s.surface_weight);
  visit(top, "normal_weight", s.normal_weight);
  visit(top, "volume_weight", s.volume_weight);
  visit(top, "eikonal_weight", s.eikonal_weight);
  visit(top, "skinning_points", s.skinning_points);
}

// Refuses what `known` does not have at the same place, and what it has and `given` lacks.
void require_same_fields(const nlohmann::ordered_json& known, const nlohmann::ordered_json& given, const std::string& where, const std::string& prefix) {
  if (!given.is_object()) throw InputError(where, prefix, "an object", given.type_name());
  for (const auto& [name, value] : given.items())
    if (!known.contains(name)) throw InputError(where, prefix + name, "a setting of this version", "an unknown field");
  for (const auto& [name, value] : known.items()) {
    if (!given.contains(name)) throw InputError(where, prefix + name, "a value", "no such field");
    if (value.is_object()) require_same_fields(value, given[name], where, prefix + name + ".");
  }
}

}  // namespace

PretrainSettings preset_pretrain_settings(const std::string& preset) {
  PretrainSettings s;
  s.preset = preset;
  // A prior in minutes: a hundred times the paper's outer rates, falling, for some hundred steps instead of 20,000.
  s.sdf = {.steps = 400, .tasks = 3, .inner_steps = 8, .inner_rate = 1e-4, .outer_rate = 1e-3, .end_fraction = 0.05};
  s.skinning = {.steps = 200, .tasks = 3, .inner_steps = 8, .inner_rate = 1e-3, .outer_rate = 5e-3, .end_fraction = 0.05};
  s.pose = {.steps = 100, .tasks = 1, .inner_steps = 4, .inner_rate = 3e-6, .outer_rate = 3e-6, .end_fraction = 0.05};
  if (preset == "tiny") return s;
  if (preset == "compact") {
    s.bodies = 24;
    s.sdf.steps = s.skinning.steps = 800;
    s.pose.steps = 300;
    s.sdf.outer_rate = 5e-4;
    return s;
  }
  if (preset == "paper") {
    s.bodies = 64;
    s.poses = 16;
    s.sdf = {.steps = 20000, .tasks = 3, .inner_steps = 24, .inner_rate = 1e-4, .outer_rate = 1e-5};
    s.skinning = {.steps = 100000, .tasks = 4, .inner_steps = 24, .inner_rate = 1e-4, .outer_rate = 1e-5};
    s.pose = {.steps = 50 * s.bodies, .tasks = 1, .inner_steps = 24, .inner_rate = 1e-6, .outer_rate = 1e-6};  // 50 epochs over the bodies
    s.surface_points = s.volume_points = 5000;
    s.skinning_points = 5000;
    return s;
  }
  throw InputError("--preset", "", "tiny, compact or paper", "'" + preset + "'");
}

std::string pretrain_settings_to_json(const PretrainSettings& settings) {
  nlohmann::ordered_json object = nlohmann::ordered_json::object();
  visit_pretrain_fields(settings, [&](const std::string& network, const char* name, const auto& value) { (network.empty() ? object : object[network])[name] = value; });
  return object.dump(2);
}

PretrainSettings pretrain_settings_from_json(const std::string& text, const std::string& where) {
  auto object = parse_json<nlohmann::ordered_json>(text, where);
  if (!object.is_object()) throw InputError(where, "", "a JSON object of pre-training settings", "something else");
  PretrainSettings settings;
  const auto known = nlohmann::ordered_json::parse(pretrain_settings_to_json(settings));
  for (const char* later : {"pose", "pose_encoder_rate", "pose_batch", "parameter_weight"})
    if (!object.contains(later)) object[later] = known[later];
  require_same_fields(known, object, where, "");
  visit_pretrain_fields(settings, [&](const std::string& network, const char* name, auto& value) {
    using T = std::decay_t<decltype(value)>;
    const auto& given = (network.empty() ? object : object[network])[name];
    const std::string field = network.empty() ? name : network + "." + name;
    if constexpr (std::is_same_v<T, std::string>) {
      if (!given.is_string()) throw InputError(where, field, "a text", given.dump());
    } else if constexpr (std::is_floating_point_v<T>) {
      if (!given.is_number() || !(given.template get<double>() >= 0)) throw InputError(where, field, "a number of at least 0", given.dump());
    } else {
      if (!given.is_number_unsigned() || given.template get<uint64_t>() > 0x7fffffff) throw InputError(where, field, "a whole number of at least 0", given.dump());
    }
    value = given.template get<T>();
  });
  const auto at_least_one = [&](const char* field, uint64_t value) {
    if (value == 0) throw InputError(where, field, "at least 1", "0");
  };
  at_least_one("bodies", settings.bodies);
  at_least_one("poses", settings.poses);
  at_least_one("sdf.tasks", settings.sdf.tasks);
  at_least_one("sdf.inner_steps", settings.sdf.inner_steps);
  at_least_one("skinning.tasks", settings.skinning.tasks);
  at_least_one("skinning.inner_steps", settings.skinning.inner_steps);
  at_least_one("pose.tasks", settings.pose.tasks);
  at_least_one("pose.inner_steps", settings.pose.inner_steps);
  at_least_one("pose_batch", settings.pose_batch);
  at_least_one("surface_points", settings.surface_points);
  at_least_one("volume_points", settings.volume_points);
  at_least_one("skinning_points", settings.skinning_points);
  return settings;
}

AvatarSpec prior_spec(const AvatarSpec& spec) {
  AvatarSpec prior;
  prior.preset = spec.preset;
  prior.skinning = spec.skinning.kind == Skinning::network ? spec.skinning : SkinningSpec{Skinning::template_weights, 0, 0};
  prior.sdf = {.width = spec.sdf.width, .sine_layers = spec.sdf.sine_layers, .omega = spec.sdf.omega, .pose = spec.sdf.pose, .pose_width = spec.sdf.pose_width, .pose_hidden_layers = spec.sdf.pose_hidden_layers};
  prior.color = {.width = 8, .hidden_layers = 1, .feature = false};  // an avatar has one; it learns nothing here
  return prior;
}

}  // namespace arah
