#include "host/training/training_settings.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <type_traits>

#include "host/body/json_fields.h"
#include "host/input_error.h"

namespace arah {
namespace {

using nlohmann::json;

constexpr double largest_rate = 1e3;

// One list of fields serves both directions: visit(name, value) for each.
template <typename Group, typename Visit>
void visit_group(Group& g, const Visit& visit) {
  visit("rate", g.rate);
  visit("freeze", g.freeze);
  visit("warm_up", g.warm_up);
  visit("max_norm", g.max_norm);
  visit("weight_decay", g.weight_decay);
}

template <typename Settings, typename Visit>
void visit_settings(Settings& s, const Visit& visit) {
  visit("preset", s.preset);
  visit("seed", s.seed);
  visit("size", s.size);
  visit("steps", s.steps);
  visit("minutes", s.minutes);
  visit("frames_per_step", s.frames_per_step);
  visit("pictures_per_frame", s.pictures_per_frame);
  visit("rays", s.rays);
  visit("rays_at_a_time", s.rays_at_a_time);
  visit("shaded_at_a_time", s.shaded_at_a_time);
  visit("mask_fraction", s.mask_fraction);
  visit("ray_importance", s.ray_importance);
  visit("rendering", s.rendering);
  visit("sampling_mode", s.sampling.mode);
  visit("samples", s.sampling.samples);
  visit("around_surface", s.sampling.around_surface);
  visit("before_surface", s.sampling.before_surface);
  visit("half_width", s.sampling.half_width);
  visit("half_width_start", s.half_width_start);
  visit("half_width_steps", s.half_width_steps);
  visit("shell_bound", s.sampling.shell_bound);
  visit("shell_cell", s.sampling.shell.cell);
  visit("shell_margin", s.sampling.shell.margin);
  visit("shell_outer", s.sampling.shell.outer);
  visit("shell_inner", s.sampling.shell.inner);
  visit("root_max_iterations", s.sampling.root.max_iterations);
  visit("root_tolerance", s.sampling.root.tolerance);
  visit("root_initialisations", s.sampling.root.initialisations);
  visit("root_rescue_steps", s.sampling.root.rescue_steps);
  visit("root_rescue_bones", s.sampling.root.rescue_bones);
  visit("root_correspondence", s.sampling.root.correspondence);
  visit("grid_steps", s.grid_steps);
  visit("view_augmentation", s.view_augmentation);
  visit("least_weight", s.least_weight);
  visit("color_weight", s.color_weight);
  visit("alpha_weight", s.alpha_weight);
  visit("mask_weight", s.mask_weight);
  visit("mask_samples", s.mask_samples);
  visit("mask_alpha", s.mask_alpha);
  visit("mask_alpha_rate", s.mask_alpha_rate);
  visit("eikonal_weight", s.eikonal_weight);
  visit("off_surface_weight", s.off_surface_weight);
  visit("inside_weight", s.inside_weight);
  visit("skinning_weight", s.skinning_weight);
  visit("parameter_weight", s.parameter_weight);
  visit("pose_noise", s.pose_noise);
  visit("pose_noise_probability", s.pose_noise_probability);
  visit("eikonal_points", s.eikonal_points);
  visit("off_surface_points", s.off_surface_points);
  visit("inside_points", s.inside_points);
  visit("skinning_points", s.skinning_points);
  visit("skinning_every", s.skinning_every);
  visit("sdf", s.sdf);
  visit("mapping", s.mapping);
  visit("skinning", s.skinning);
  visit("color", s.color);
  visit("latent", s.latent);
  visit("deviation", s.deviation);
  visit("grid", s.grid);
  visit("pose_code", s.pose_code);
  visit("hyper", s.hyper);
  visit("low_rank", s.low_rank);
  visit("hyper_last", s.hyper_last);
  visit("pose_refinement", s.pose_refinement);
  visit("poses", s.poses);
  visit("poses_every", s.poses_every);
  visit("shell_drift", s.shell_drift);
  visit("disturb_degrees", s.disturb_degrees);
  visit("disturb_metres", s.disturb_metres);
  visit("shape_refinement", s.shape_refinement);
  visit("shape", s.shape);
  visit("disturb_shape", s.disturb_shape);
  visit("end_fraction", s.end_fraction);
  visit("average_decay", s.average_decay);
  visit("checkpoint_minutes", s.checkpoint_minutes);
  visit("on_bad_value", s.on_bad_value);
  visit("fit_steps", s.fit_steps);
  visit("fit_skinning_steps", s.fit_skinning_steps);
  visit("fit_rate", s.fit_rate);
  visit("fit_skinning_rate", s.fit_skinning_rate);
  visit("clothing", s.clothing);
  visit("prior", s.prior);
  visit("prior_fit_steps", s.prior_fit_steps);
  visit("prior_fit_skinning_steps", s.prior_fit_skinning_steps);
}

struct Writer {
  json& object;
  template <typename T>
  void operator()(const char* name, const T& value) const {
    if constexpr (std::is_same_v<T, GroupSettings>) visit_group(value, Writer{object[name]});
    else if constexpr (std::is_enum_v<T>) object[name] = to_string(value);
    else object[name] = value;
  }
};

struct Reader {
  const json& object;
  const std::string& where;
  const std::string prefix;
  mutable std::set<std::string> known = {};

  template <typename T>
  void operator()(const char* name, T& value) const {
    known.insert(name);
    const std::string field = prefix + name;
    const auto found = object.find(name);
    if (found == object.end()) throw InputError(where, field, "a value", "no such field");
    if constexpr (std::is_same_v<T, GroupSettings>) {
      if (!found->is_object()) throw InputError(where, field, "an object", found->type_name());
      const Reader reader{*found, where, field + "."};
      visit_group(value, reader);
      reader.refuse_unknown();
    } else if constexpr (std::is_same_v<T, SamplingMode>) {
      read_word(found->dump(), field, {SamplingMode::shell, SamplingMode::surface, SamplingMode::uniform}, value);
    } else if constexpr (std::is_same_v<T, Rendering>) {
      read_word(found->dump(), field, {Rendering::volume, Rendering::surface}, value);
    } else if constexpr (std::is_same_v<T, OnBadValue>) {
      read_word(found->dump(), field, {OnBadValue::stop, OnBadValue::skip}, value);
    } else if constexpr (std::is_same_v<T, Correspondence>) {
      read_word(found->dump(), field, {Correspondence::search, Correspondence::search_from_grid, Correspondence::grid, Correspondence::grid_alone}, value);
    } else {
      const bool fits = std::is_same_v<T, std::string> ? found->is_string()
                        : std::is_same_v<T, bool>      ? found->is_boolean()
                        : std::is_floating_point_v<T>  ? found->is_number()
                                                       : found->is_number_unsigned() && (sizeof(T) == 8 || found->template get<uint64_t>() <= 0x7fffffff);
      if (!fits) throw InputError(where, field, std::is_same_v<T, std::string> ? "a text" : std::is_same_v<T, bool> ? "true or false" : std::is_floating_point_v<T> ? "a number" : "a whole number of at least 0", found->dump());
      value = found->template get<T>();
    }
  }
  template <typename Enum>
  void read_word(const std::string& quoted, const std::string& field, std::initializer_list<Enum> words, Enum& value) const {
    std::string expected;
    for (const Enum word : words) {
      if (quoted == fmt::format("\"{}\"", to_string(word))) {
        value = word;
        return;
      }
      expected += fmt::format("{}{}", expected.empty() ? "" : " or ", to_string(word));
    }
    throw InputError(where, field, expected, quoted);
  }
  void refuse_unknown() const {
    for (const auto& [name, value] : object.items())
      if (!known.contains(name)) throw InputError(where, prefix + name, "a setting of this version", "an unknown field");
  }
};

}  // namespace

void search_for_refinement(TrainingSettings& settings) {
  Correspondence& from = settings.sampling.root.correspondence;
  if (settings.pose_refinement && (from == Correspondence::grid || from == Correspondence::grid_alone)) from = Correspondence::search_from_grid;
}

TrainingSettings preset_settings(const std::string& preset) {
  TrainingSettings s;
  s.preset = preset;
  s.sampling.root.max_iterations = 10;
  s.sampling.root.tolerance = 1e-4f;  // about a thirtieth of b
  s.sampling.root.correspondence = Correspondence::grid_alone;
  s.sdf = {.rate = 2e-4, .freeze = 200, .warm_up = 200, .max_norm = 10};
  // Its last layer shifts the argument of every sine by ω times a sum over its hidden channels: 256 weights that Adam moves by
  // 1e-4 each turn a phase by some 0.3 rad a step, and the shape is gone after five. As the paper's hyper-networks: 1e-6.
  s.mapping = {.rate = 1e-6, .freeze = 200, .warm_up = 200, .max_norm = 10};
  s.skinning = {.rate = 1e-4, .freeze = 200, .warm_up = 200, .max_norm = 10};
  s.color = {.rate = 1e-3, .warm_up = 100};
  s.latent = {.rate = 1e-3};
  s.deviation = {.rate = 1e-4, .freeze = 200};  // else b shrinks to a tenth while the shape cannot follow
  s.grid = {.rate = 1e-2};
  s.pose_code = {.rate = 1e-4, .freeze = 200, .warm_up = 200, .max_norm = 10};
  // A number of the SDF is a sum over 256 hidden values, all of them positive, whose weights Adam first moves together: 1e-6, the
  // released rate, for which the hypernetwork must be trained already, moves it by 1e-4 a step. From there the surface was lost
  // within 100 steps in spite of the warm-up; a tenth of it keeps it, once colours have been learnt
  // (docs/decisions/pose-conditioning.md).
  s.hyper = s.hyper_last = {.rate = 1e-7, .freeze = 200, .warm_up = 200, .max_norm = 10};
  s.low_rank = {.rate = 1e-5, .freeze = 200, .warm_up = 200, .max_norm = 10};
  s.poses = {.rate = 2e-3, .freeze = 200};  // a frame has its turn some ten times; at first colours say nothing about poses
  s.shape = s.poses;
  s.poses_every = 4;                        // every other one is a step in which the skinning network learns from colours
  if (preset == "tiny") return s;
  if (preset == "compact") {
    s.sdf.rate = 1e-4;
    s.fit_rate = 5e-4;
    s.minutes = 30;
    return s;
  }
  if (preset == "paper") {
    s.rays = 2048;
    s.mask_fraction = 0.5;
    s.sampling.mode = SamplingMode::surface;
    s.sampling.samples = 64;
    s.view_augmentation = 0.5;
    s.least_weight = 0;
    s.sampling.root.max_iterations = 50;
    s.sampling.root.tolerance = 1e-5f;
    s.sampling.root.correspondence = Correspondence::search;
    s.eikonal_weight = 50;
    s.alpha_weight = 0;
    s.eikonal_points = s.off_surface_points = s.inside_points = s.skinning_points = 1024;
    s.skinning_every = 1;
    s.sdf = {.rate = 1e-4, .freeze = 200, .warm_up = 200, .max_norm = 10};
    s.skinning = s.color = {.rate = 1e-4};  // b stays frozen at first as in the others: 1e-4 m a step takes its 1 mm to 0 in ten
    s.latent = {.rate = 1e-4, .weight_decay = 0.05};
    s.poses = s.shape = {.rate = 1e-4};
    s.poses_every = 1;
    s.end_fraction = 1;
    s.fit_rate = 2e-4;
    s.minutes = 600;
    s.checkpoint_minutes = 10;  // of 1.7 GB
    return s;
  }
  throw InputError("--preset", "", "tiny, compact or paper", "'" + preset + "'");
}

std::string settings_to_json(const TrainingSettings& settings) {
  json object = json::object();
  visit_settings(settings, Writer{object});
  return object.dump(2);
}

TrainingSettings settings_from_json(const std::string& text, const std::string& where) {
  const json object = parse_json(text, where);
  if (!object.is_object()) throw InputError(where, "", "a JSON object of training settings", "something else");
  TrainingSettings settings;
  const Reader reader{object, where, ""};
  visit_settings(settings, reader);
  reader.refuse_unknown();
  if (settings.grid_steps == 0) throw InputError(where, "grid_steps", "at least 1", "0");
  if (settings.rays == 0 || settings.sampling.samples == 0) throw InputError(where, "rays, samples", "at least 1", "0");
  if (settings.frames_per_step == 0 || settings.frames_per_step > 8 || settings.pictures_per_frame == 0 || settings.pictures_per_frame > 64)
    throw InputError(where, "frames_per_step, pictures_per_frame", "1 to 8 and 1 to 64", fmt::format("{} and {}", settings.frames_per_step, settings.pictures_per_frame));
  if (uint64_t(settings.rays) * settings.frames_per_step * settings.pictures_per_frame > 0x7fffffff) throw InputError(where, "rays", "at most 2^31 in a step", fmt::format("{} of each picture", settings.rays));
  if (!(settings.parameter_weight >= 0 && settings.pose_noise >= 0 && settings.pose_noise_probability >= 0 && settings.pose_noise_probability <= 1))
    throw InputError(where, "parameter_weight, pose_noise, pose_noise_probability", "at least 0, the probability at most 1", fmt::format("{}, {}, {}", settings.parameter_weight, settings.pose_noise, settings.pose_noise_probability));
  // Above, one ray's weight could be more than ten times another's.
  if (!(settings.ray_importance >= 0 && settings.ray_importance <= 0.9)) throw InputError(where, "ray_importance", "a share from 0 to 0.9", fmt::format("{}", settings.ray_importance));
  if (settings.poses_every == 0) throw InputError(where, "poses_every", "at least 1", "0");
  if (!(settings.shell_drift >= 0 && settings.disturb_degrees >= 0 && settings.disturb_metres >= 0 && settings.disturb_shape >= 0))
    throw InputError(where, "shell_drift, disturb_degrees, disturb_metres, disturb_shape", "numbers of at least 0", fmt::format("{}, {}, {}, {}", settings.shell_drift, settings.disturb_degrees, settings.disturb_metres, settings.disturb_shape));
  if (!(settings.view_augmentation >= 0 && settings.view_augmentation <= 1)) throw InputError(where, "view_augmentation", "a probability from 0 to 1", fmt::format("{}", settings.view_augmentation));
  if (settings.sampling.around_surface % 2 == 0) throw InputError(where, "around_surface", "an odd number: the middle sample is the surface itself", fmt::format("{}", settings.sampling.around_surface));
  if (!(settings.sampling.half_width > 0 && settings.half_width_start >= 0)) throw InputError(where, "half_width, half_width_start", "metres, above 0 and at least 0", fmt::format("{}, {}", settings.sampling.half_width, settings.half_width_start));
  const uint32_t least = settings.sampling.around_surface + settings.sampling.before_surface;
  if (settings.sampling.mode == SamplingMode::surface && settings.sampling.samples < least)
    throw InputError(where, "samples", fmt::format("at least {} with sampling_mode surface", least), fmt::format("{}", settings.sampling.samples));
  if (settings.sampling.root.initialisations < 1 || settings.sampling.root.initialisations > 8) throw InputError(where, "root_initialisations", "from 1 to 8", fmt::format("{}", settings.sampling.root.initialisations));
  if (settings.sampling.root.rescue_steps > 1000 || settings.sampling.root.rescue_bones > 8)
    throw InputError(where, "root_rescue_steps, root_rescue_bones", "at most 1000 and 8", fmt::format("{}, {}", settings.sampling.root.rescue_steps, settings.sampling.root.rescue_bones));
  // A frame's grid of roots would hold what an SDF said that is gone when a training is resumed.
  if (settings.sampling.root.initialisations > 1 && settings.sampling.root.correspondence != Correspondence::search)
    throw InputError(where, "root_initialisations", "1 where root_correspondence is not search", fmt::format("{}", settings.sampling.root.initialisations));
  if (settings.mask_samples == 0 || settings.mask_samples > 1024) throw InputError(where, "mask_samples", "from 1 to 1024", fmt::format("{}", settings.mask_samples));
  if (!(settings.mask_weight >= 0 && settings.mask_alpha > 0 && settings.mask_alpha_rate >= 0))
    throw InputError(where, "mask_weight, mask_alpha, mask_alpha_rate", "at least 0, above 0, at least 0", fmt::format("{}, {}, {}", settings.mask_weight, settings.mask_alpha, settings.mask_alpha_rate));
  return settings;
}

const char* to_string(OnBadValue on_bad_value) { return on_bad_value == OnBadValue::skip ? "skip" : "stop"; }

const char* to_string(Rendering rendering) { return rendering == Rendering::surface ? "surface" : "volume"; }

SamplingSettings TrainingSettings::color_sampling() const {
  SamplingSettings result = sampling;
  if (rendering == Rendering::surface) result.mode = SamplingMode::surface_only, result.samples = 1;
  return result;
}

void check_settings(const TrainingSettings& settings, const AvatarSpec& spec, const std::string& where) {
  // Adam moves a number by about its rate in a step. Beyond these bounds one step, or decay alone, can take a number out of float32's
  // range where nothing computed from it shows that: b is clipped, and codes of frames without a picture are not read.
  const auto rate = [&](const std::string& field, double value) {
    if (!(value >= 0 && value <= largest_rate)) throw InputError(where, field, fmt::format("a rate from 0 to {}", largest_rate), fmt::format("{}", value));
  };
  visit_settings(settings, [&](const char* name, const auto& value) {
    if constexpr (std::is_same_v<std::remove_cvref_t<decltype(value)>, GroupSettings>) {
      const std::string group = name;
      rate(group + ".rate", value.rate);
      if (!(value.weight_decay >= 0 && value.rate * value.weight_decay <= 1)) throw InputError(where, group + ".weight_decay", "from 0 to 1 / rate: a step takes off the share rate * weight_decay", fmt::format("{}", value.weight_decay));
      if (!(value.max_norm >= 0 && std::isfinite(value.max_norm))) throw InputError(where, group + ".max_norm", "a number of at least 0", fmt::format("{}", value.max_norm));
    }
  });
  rate("mask_alpha_rate", settings.mask_alpha_rate);
  rate("fit_rate", settings.fit_rate);
  rate("fit_skinning_rate", settings.fit_skinning_rate);
  const bool backward = spec.skinning.kind == Skinning::backward, density = spec.sdf.kind == FieldKind::density, surface = settings.rendering == Rendering::surface;
  if ((backward || density) && surface)
    throw InputError(where, "rendering", backward ? "volume with skinning.kind backward, which knows no way from the surface to posed space" : "volume with sdf.kind density, which has no surface", "surface");
  if (backward && settings.sampling.mode != SamplingMode::shell)
    throw InputError(where, "sampling_mode", "shell with skinning.kind backward, which knows no way from the surface to posed space", to_string(settings.sampling.mode), "arah train: --set sampling_mode=shell");
  if (density && settings.sampling.mode != SamplingMode::shell && settings.sampling.mode != SamplingMode::uniform)
    throw InputError(where, "sampling_mode", "shell or uniform with sdf.kind density, which has no surface to search", to_string(settings.sampling.mode), "arah train: --set sampling_mode=shell");
  if ((backward || surface) && settings.pose_refinement)
    throw InputError(where, "pose_refinement", backward ? "false with skinning.kind backward, whose weights follow the pose themselves" : "false with rendering surface, whose gradients go to the networks alone", "true", "arah train: --set pose_refinement=false");
}

double half_width(const TrainingSettings& settings, uint64_t step) {
  const double end = settings.sampling.half_width;
  if (settings.half_width_start == 0 || step >= settings.half_width_steps) return end;
  return settings.half_width_start + (end - settings.half_width_start) * double(step) / double(settings.half_width_steps);
}

double rate_factor(const GroupSettings& group, const TrainingSettings& settings, uint64_t step, double done) {
  if (step < group.freeze) return 0;
  const double warm = group.warm_up == 0 ? 1.0 : std::min(1.0, double(step - group.freeze + 1) / double(group.warm_up));
  const double cosine = settings.end_fraction + (1 - settings.end_fraction) * 0.5 * (1 + std::cos(std::numbers::pi * std::min(done, 1.0)));
  return warm * cosine;
}

}  // namespace arah
