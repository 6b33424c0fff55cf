#include "host/rendering/render_settings.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "host/input_error.h"

namespace arah {
namespace {

double number(const std::string& name, const std::string& value, double least, double most, bool whole) {
  double result = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), result);
  const bool read = error == std::errc() && end == value.data() + value.size();
  if (!read || !(result >= least && result <= most) || (whole && result != std::floor(result)))
    throw InputError(name, "", fmt::format("a {} from {} to {}", whole ? "whole number" : "number", least, most), "'" + value + "'");
  return result;
}

template <typename Enum>
Enum word(const std::string& name, const std::string& value, std::initializer_list<Enum> words) {
  std::vector<std::string> known;
  for (const Enum candidate : words) {
    if (value == to_string(candidate)) return candidate;
    known.emplace_back(to_string(candidate));
  }
  throw InputError(name, "", fmt::format("one of {}", fmt::join(known, ", ")), "'" + value + "'");
}

struct Knob {
  const char* name;
  std::function<void(RenderSettings&, const std::string&, const std::string&)> set;  // settings, name, value
  std::function<nlohmann::ordered_json(const RenderSettings&)> get;
};

const std::vector<Knob>& knobs() {
  using Settings = RenderSettings;
  using Json = nlohmann::ordered_json;
  static const std::vector<Knob> all{
      {"sampling_mode",
       [](Settings& s, const std::string& n, const std::string& v) { 
         s.sampling->mode = word(n, v, {SamplingMode::shell, SamplingMode::surface, SamplingMode::surface_only, SamplingMode::uniform});
         if (s.sampling->mode == SamplingMode::surface_only) s.sampling->samples = 1;
         if (s.sampling->mode == SamplingMode::uniform) s.sampling->samples = 64;
       },
       [](const Settings& s) { return Json(to_string(s.sampling->mode)); }},
      {"samples", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->samples = static_cast<uint32_t>(number(n, v, 1, 1024, true)); },
       [](const Settings& s) { return Json(s.sampling->samples); }},
      {"around_surface",
       [](Settings& s, const std::string& n, const std::string& v) {
         const double count = number(n, v, 1, 1023, true);
         if (std::fmod(count, 2) == 0) throw InputError(n, "", "an odd number: the middle sample is the surface itself", "'" + v + "'");
         s.sampling->around_surface = static_cast<uint32_t>(count);
       },
       [](const Settings& s) { return Json(s.sampling->around_surface); }},
      {"before_surface", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->before_surface = static_cast<uint32_t>(number(n, v, 0, 1024, true)); },
       [](const Settings& s) { return Json(s.sampling->before_surface); }},
      {"half_width", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->half_width = number(n, v, 1e-4, 1, false); }, [](const Settings& s) { return Json(s.sampling->half_width); }},
      {"half_width_b", [](Settings& s, const std::string& n, const std::string& v) { s.half_width_b = number(n, v, 0, 1000, false); }, [](const Settings& s) { return Json(s.half_width_b); }},
      {"surface", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->surface = word(n, v, {SurfaceSource::search, SurfaceSource::mesh}); },
       [](const Settings& s) { return Json(to_string(s.sampling->surface)); }},
      {"outline", [](Settings& s, const std::string& n, const std::string& v) { s.outline = number(n, v, 0, 10, false); }, [](const Settings& s) { return Json(s.outline); }},
      {"distances",
       [](Settings& s, const std::string& n, const std::string& v) {
         if (v != "network" && v != "baked") throw InputError(n, "", "network or baked", "'" + v + "'");
         s.baked_distances = v == "baked";
       },
       [](const Settings& s) { return Json(s.baked_distances ? "baked" : "network"); }},
      {"sdf_by_pose",
       [](Settings& s, const std::string& n, const std::string& v) {
         if (v != "frame" && v != "shared") throw InputError(n, "", "frame or shared", "'" + v + "'");
         s.shared_sdf = v == "shared";
       },
       [](const Settings& s) { return Json(s.shared_sdf ? "shared" : "frame"); }},
      {"bake_cell", [](Settings& s, const std::string& n, const std::string& v) { s.bake_cell = number(n, v, 0.001, 0.1, false); }, [](const Settings& s) { return Json(s.bake_cell); }},
      {"shell_bound",
       [](Settings& s, const std::string& n, const std::string& v) {
         if (v != "true" && v != "false") throw InputError(n, "", "true or false", "'" + v + "'");
         s.sampling->shell_bound = v == "true";
       },
       [](const Settings& s) { return Json(s.sampling->shell_bound); }},
      {"trace_start",
       [](Settings& s, const std::string& n, const std::string& v) {
         if (v != "box" && v != "shell") throw InputError(n, "", "box or shell", "'" + v + "'");
         s.sampling->root.trace_from_shell = v == "shell";
       },
       [](const Settings& s) { return Json(s.sampling->root.trace_from_shell ? "shell" : "box"); }},
      {"trace_tolerance", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->root.trace_tolerance = static_cast<float>(number(n, v, 1e-7, 1, false)); },
       [](const Settings& s) { return Json(s.sampling->root.trace_tolerance); }},
      {"root_tolerance", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->root.tolerance = static_cast<float>(number(n, v, 1e-7, 1, false)); },
       [](const Settings& s) { return Json(s.sampling->root.tolerance); }},
      {"root_max_iterations", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->root.max_iterations = static_cast<uint32_t>(number(n, v, 1, 1000, true)); },
       [](const Settings& s) { return Json(s.sampling->root.max_iterations); }},
      {"root_initialisations", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->root.initialisations = static_cast<uint32_t>(number(n, v, 1, 8, true)); },
       [](const Settings& s) { return Json(s.sampling->root.initialisations); }},
      {"root_rescue_steps", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->root.rescue_steps = static_cast<uint32_t>(number(n, v, 0, 1000, true)); },
       [](const Settings& s) { return Json(s.sampling->root.rescue_steps); }},
      {"root_rescue_bones", [](Settings& s, const std::string& n, const std::string& v) { s.sampling->root.rescue_bones = static_cast<uint32_t>(number(n, v, 0, 8, true)); },
       [](const Settings& s) { return Json(s.sampling->root.rescue_bones); }},
      {"root_correspondence",
       [](Settings& s, const std::string& n, const std::string& v) {
         s.sampling->root.correspondence = word(n, v, {Correspondence::search, Correspondence::search_from_grid, Correspondence::grid, Correspondence::grid_alone});
       },
       [](const Settings& s) { return Json(to_string(s.sampling->root.correspondence)); }},
      {"color_groups", [](Settings& s, const std::string& n, const std::string& v) { s.color_groups = static_cast<uint32_t>(number(n, v, 0, 1024, true)); },
       [](const Settings& s) { return Json(s.color_groups); }},
      {"least_weight", [](Settings& s, const std::string& n, const std::string& v) { s.least_weight = number(n, v, 0, 1, false); }, [](const Settings& s) { return Json(s.least_weight); }},
      {"arithmetic",
       [](Settings& s, const std::string& n, const std::string& v) { s.arithmetic = word(n, v, {Arithmetic::float32, Arithmetic::half_storage, Arithmetic::cooperative_matrix}); },
       [](const Settings& s) { return Json(to_string(s.arithmetic)); }},
      {"pixel_step", [](Settings& s, const std::string& n, const std::string& v) { s.pixel_step = static_cast<int>(number(n, v, 1, 16, true)); }, [](const Settings& s) { return Json(s.pixel_step); }}};
  return all;
}

}  // namespace

SamplingSettings picture_sampling(const Avatar& avatar) {
  SamplingSettings sampling;
  sampling.samples = 32;
  const nlohmann::json trained = nlohmann::json::parse(avatar.settings, nullptr, false);
  if (!trained.is_object()) return sampling;
  if (trained.value("rendering", nlohmann::json()) == "surface") {
    sampling.mode = SamplingMode::surface_only;
    sampling.samples = 1;
    return sampling;
  }
  for (const SamplingMode mode : {SamplingMode::surface, SamplingMode::uniform})
    if (trained.value("sampling_mode", nlohmann::json()) == to_string(mode)) sampling.mode = mode, sampling.samples = 64;
  return sampling;
}

const std::vector<std::string>& render_presets() {
  static const std::vector<std::string> names{"paper", "balanced", "fast", "preview"};
  return names;
}

RenderSettings render_preset(const Avatar& avatar, const std::string& name) {
  RenderSettings settings;
  settings.sampling = picture_sampling(avatar);
  settings.least_weight = 1e-8;  // of 64 samples together at most 6.4e-7 of a colour
  if (name == "paper") return settings;
  SamplingSettings& sampling = *settings.sampling;
  sampling.root.tolerance = 1e-4f;
  sampling.root.max_iterations = 12;
  sampling.root.correspondence = Correspondence::grid;
  settings.least_weight = 1e-4;
  settings.baked_distances = avatar.spec.sdf.kind == FieldKind::sdf;
  settings.bake_cell = 0.008;
  if (asks_for_surface(sampling.mode)) sampling.surface = SurfaceSource::mesh;
  if (name == "balanced") return settings;
  if (sampling.mode != SamplingMode::surface_only) {
    sampling.mode = SamplingMode::shell;
    sampling.samples = 20;
    settings.bake_cell = 0.01;
  }
  settings.color_groups = 1;
  settings.least_weight = 1e-2;
  if (name == "fast") return settings;
  sampling.mode = SamplingMode::surface_only;
  sampling.samples = 1;
  sampling.surface = SurfaceSource::mesh;
  settings.bake_cell = 0.008;  // coarser cells reach farther out, where the network was never taught and has surfaces of its own
  settings.outline = 0.5;
  settings.shared_sdf = true;  // else each new pose is baked anew
  if (name == "preview") return settings;
  throw InputError("--quality", "", fmt::format("one of {}", fmt::join(render_presets(), ", ")), "'" + name + "'");
}

std::vector<std::string> render_knobs() {
  std::vector<std::string> names;
  for (const Knob& knob : knobs()) names.emplace_back(knob.name);
  return names;
}

void set_render_knob(RenderSettings& settings, const std::string& name, const std::string& value) {
  for (const Knob& knob : knobs())
    if (name == knob.name) return knob.set(settings, name, value);
  throw InputError(name, "", fmt::format("one of {}", fmt::join(render_knobs(), ", ")), "no such knob");
}

std::string render_settings_json(const RenderSettings& settings) {
  nlohmann::ordered_json json;
  for (const Knob& knob : knobs()) json[knob.name] = knob.get(settings);
  return json.dump();
}

}  // namespace arah
