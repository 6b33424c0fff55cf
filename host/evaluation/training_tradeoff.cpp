#include "host/evaluation/training_tradeoff.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "host/training/trainer.h"

namespace arah {
namespace {

using Changes = std::vector<std::pair<std::string, std::string>>;

// What an avatar's file does not say (it is older than the setting, or was never trained) is as its preset has it.
TrainingSettings settings_of(const Avatar& avatar) {
  nlohmann::ordered_json json = nlohmann::ordered_json::parse(settings_to_json(preset_settings(avatar.spec.preset)));
  if (!avatar.settings.empty()) json.update(nlohmann::ordered_json::parse(avatar.settings));
  return settings_from_json(json.dump(), "the avatar's training settings");
}

// As config.json would have it.
TrainingSettings changed_settings(const TrainingSettings& exact, const Changes& changes) {
  nlohmann::ordered_json json = nlohmann::ordered_json::parse(settings_to_json(exact));
  for (const auto& [name, value] : changes) json[name] = json[name].is_string() ? nlohmann::ordered_json(value) : nlohmann::ordered_json::parse(value);
  return settings_from_json(json.dump(), "training settings");
}

std::vector<Changes> training_changes(const TrainingSettings& trained, bool searches) {
  std::vector<Changes> all;
  const auto each = [&](const char* name, std::initializer_list<const char*> values) {
    for (const char* value : values) all.push_back({{name, value}});
  };
  if (trained.sampling.mode != SamplingMode::shell) each("shell_bound", {"true"});
  each("least_weight", {"1e-6", "1e-4", "1e-3", "1e-2"});
  if (searches) {
    each("root_tolerance", {"1e-4", "1e-3"});
    each("root_max_iterations", {"12"});
    each("root_correspondence", {"grid", "grid_alone"});
  }
  return all;
}

// The first step's gradient, by group: Adam's first moments are a tenth of it, because they were 0 before and nothing is
// clipped.
std::vector<std::pair<std::string, std::vector<float>>> gradients_after_first_step(Trainer& trainer, const ParameterLayout& layout) {
  const SafetensorsFile file = trainer.checkpoint();
  const std::vector<float> moments = file.values<float>("optimizer.first_moments", {static_cast<int64_t>(layout.floats)});
  std::vector<std::pair<std::string, std::vector<float>>> result;
  for (const ParameterGroup& group : layout.groups)
    if (group.size() > 0) result.emplace_back(group.name, std::vector<float>(moments.begin() + static_cast<std::ptrdiff_t>(group.begin), moments.begin() + static_cast<std::ptrdiff_t>(group.end)));
  return result;
}

double relative_difference(const std::vector<float>& a, const std::vector<float>& exact) {
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    difference += std::pow(double{a[i]} - double{exact[i]}, 2);
    size += std::pow(double{exact[i]}, 2);
  }
  return size > 0 ? std::sqrt(difference / size) : difference > 0 ? INFINITY : 0;
}

}  // namespace

TrainingTradeoff measure_training_tradeoff(Device& device, const Avatar& avatar, const Capture& capture, const TrainingTradeoffSettings& settings,
                                           const std::function<void(double, const std::string&)>& progress) {
  TrainingSettings trained = settings_of(avatar);
  if (settings.rays) trained.rays = settings.rays;
  trained.size = settings.size;
  trained.rays_at_a_time = 0;
  for (GroupSettings* group : {&trained.sdf, &trained.mapping, &trained.skinning, &trained.color, &trained.latent, &trained.deviation, &trained.grid, &trained.pose_code, &trained.hyper, &trained.low_rank, &trained.hyper_last}) {
    group->freeze = group->warm_up = 0;
    group->max_norm = group->weight_decay = 0;
  }
  TrainingSettings exact = trained;
  exact.least_weight = 0;
  exact.sampling.shell_bound = false;
  exact.sampling.root = RootFindingSettings{};

  const bool searches = avatar.spec.skinning.kind == Skinning::network;
  std::vector<std::pair<std::string, TrainingSettings>> measured{{"exact", exact}};
  std::vector<Changes> changes{{}};
  for (const Changes& some : training_changes(trained, searches)) {
    measured.emplace_back(fmt::format("{} {}", some.front().first, some.front().second), changed_settings(exact, some));
    changes.push_back(some);
  }
  measured.emplace_back("as trained", trained);
  changes.emplace_back();

  TrainingTradeoff result;
  result.device = device.report().name;
  result.driver = device.report().driver;
  result.rays = trained.rays;
  result.samples = trained.sampling.samples;
  std::vector<std::pair<std::string, std::vector<float>>> truth;
  for (std::size_t i = 0; i < measured.size(); ++i) {
    const auto& [name, chosen] = measured[i];
    if (progress) progress(double(i) / double(measured.size()), name);
    Trainer trainer(device, capture, avatar, chosen);
    TrainingTradeoffPoint point;
    point.name = name;
    point.changes = changes[i];
    const StepReport first = trainer.step(1000);
    point.shaded = first.shaded;
    point.found = first.converged;
    const auto gradients = gradients_after_first_step(trainer, avatar.layout);
    if (truth.empty()) truth = gradients;
    for (std::size_t g = 0; g < gradients.size(); ++g) point.gradient_error.emplace_back(gradients[g].first, relative_difference(gradients[g].second, truth[g].second));
    std::vector<double> times;
    for (uint32_t repetition = 0; repetition < std::max(settings.repetitions, 1u); ++repetition) {
      const auto start = std::chrono::steady_clock::now();
      trainer.step(1000);
      times.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
    }
    std::sort(times.begin(), times.end());
    point.milliseconds = times[times.size() / 2];
    point.fastest = times.front();
    point.slowest = times.back();
    result.points.push_back(std::move(point));
  }
  return result;
}

std::string training_tradeoff_csv(const TrainingTradeoff& tradeoff) {
  std::string text = "setting,milliseconds,fastest,slowest,shaded,found";
  for (const auto& [group, error] : tradeoff.points.front().gradient_error) text += ",gradient error " + group;
  text += "\n";
  for (const TrainingTradeoffPoint& p : tradeoff.points) {
    text += fmt::format("\"{}\",{:.2f},{:.2f},{:.2f},{:.5f},{:.5f}", p.name, p.milliseconds, p.fastest, p.slowest, p.shaded, p.found);
    for (const auto& [group, error] : p.gradient_error) text += fmt::format(",{:.3e}", error);
    text += "\n";
  }
  return text;
}

std::string training_tradeoff_table(const TrainingTradeoff& tradeoff) {
  std::string text = fmt::format("one training step of {} rays x {} samples on {} ({}); gradients: |g - exact| / |exact|, by group\n{:<34}{:>10}{:>18}{:>8}{:>8}", tradeoff.rays, tradeoff.samples, tradeoff.device,
                                 tradeoff.driver, "setting", "ms", "(spread)", "shaded", "found");
  for (const auto& [group, error] : tradeoff.points.front().gradient_error) text += fmt::format("{:>11}", group);
  text += "\n";
  for (const TrainingTradeoffPoint& p : tradeoff.points) {
    text += fmt::format("{:<34}{:>10.1f}{:>18}{:>8.4f}{:>8.4f}", p.name, p.milliseconds, fmt::format("({:.0f}-{:.0f})", p.fastest, p.slowest), p.shaded, p.found);
    for (const auto& [group, error] : p.gradient_error) text += fmt::format("{:>11.1e}", error);
    text += "\n";
  }
  return text;
}

}  // namespace arah
