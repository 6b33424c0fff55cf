#include "host/training/run_choice.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string_view>

#include "host/avatar/spec_choice.h"
#include "host/body/json_fields.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::string_view kOfSpec = "spec.";  // what the name of a part of the avatar begins with

}  // namespace

RunConfig chosen_config(const Capture& capture, const std::string& preset, std::vector<std::string>* reasons) {
  const SpecChoice choice = choose_spec(preset, capture_facts(capture));
  if (reasons) *reasons = choice.reasons;
  RunConfig config = make_run_config(capture, preset_settings(preset), choice.spec);
  config.settings.pose_refinement = choice.pose_refinement;
  config.settings.shape_refinement = choice.shape_refinement;
  return config;
}

std::string with_field(const std::string& text, const std::string& assignment, const char* option, const char* example) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos)
    throw InputError(option, "", "NAME=VALUE", "'" + assignment + "'", fmt::format("For instance: {} {}", option, example));
  const std::string name = assignment.substr(0, equals), value = assignment.substr(equals + 1);
  auto json = nlohmann::ordered_json::parse(text);
  nlohmann::ordered_json* place = &json;
  for (std::size_t from = 0; from <= name.size();) {
    const std::size_t to = std::min(name.find('.', from), name.size());
    const std::string part = name.substr(from, to - from);
    if (!place->is_object() || !place->contains(part))
      throw InputError(option, name, "a field by its name", "no such field");
    place = &(*place)[part];
    from = to + 1;
  }
  try {
    *place = parse_json<nlohmann::ordered_json>(value, option, name);
  } catch (const InputError&) {
    *place = value;  // a word
  }
  return json.dump();
}

void assign(RunConfig& config, const std::vector<std::string>& assignments, const char* option) {
  if (assignments.empty()) return;
  std::string settings = settings_to_json(config.settings), spec = spec_to_json(config.spec);
  for (const std::string& assignment : assignments) {
    if (assignment.starts_with(kOfSpec) && assignment.find('=') != std::string::npos)
      spec = with_field(spec, assignment.substr(kOfSpec.size()), fmt::format("{} spec", option).c_str(), "spec.sdf.width=96");
    else settings = with_field(settings, assignment, option, "fit_steps=200");
  }
  config.settings = settings_from_json(settings, option);
  config.spec = spec_from_json(spec, fmt::format("{}: spec", option));
}

void check_size(const TrainingSettings& settings, const Capture& capture) {
  for (const Camera& camera : capture.cameras)
    if (camera.role == "train" && settings.size > camera.width)
      throw InputError("--size", "", fmt::format("at most the {} columns of camera '{}'", camera.width, camera.name),
                       fmt::format("{}", settings.size));
}

}  // namespace arah
