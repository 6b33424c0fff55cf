#include "viewer/quality.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace arah {
namespace {

constexpr double kNextPreset = 4;  // about what each preset costs more than the quicker one (docs/decisions/render-presets.md)

}  // namespace

std::string to_string(const Quality& quality) { return quality.pixel_step == 1 ? quality.preset : fmt::format("{} 1/{}", quality.preset, quality.pixel_step); }

RenderSettings preset_with_knobs(const Avatar& avatar, const std::string& preset, const std::map<std::string, std::string>& knobs) {
  RenderSettings settings = render_preset(avatar, preset);
  for (const std::string& knob : render_knobs())
    if (const auto found = knobs.find(knob); found != knobs.end()) set_render_knob(settings, knob, found->second);
  return settings;
}

std::vector<Quality> qualities(const Avatar& avatar) {
  std::vector<Quality> all;
  for (const std::string& preset : render_presets())
    if (preset != "preview" || avatar.spec.sdf.kind == FieldKind::sdf) all.push_back({preset, 1});
  const std::string quickest = all.back().preset;
  for (const int step : {2, 3, 4, 6, 8}) all.push_back({quickest, step});
  return all;
}

std::vector<Quality> refinement(const Avatar& avatar, const std::string& finest) {
  std::vector<Quality> steps = qualities(avatar);
  std::erase_if(steps, [](const Quality& quality) { return quality.pixel_step > 1; });
  const auto end = std::find_if(steps.begin(), steps.end(), [&](const Quality& quality) { return quality.preset == finest; });
  if (end != steps.end()) steps.erase(steps.begin(), end);
  std::reverse(steps.begin(), steps.end());
  return steps;
}

MovingQuality::MovingQuality(const Avatar& avatar, double seconds) : budget_(seconds), choices_(qualities(avatar)), last_(choices_.size() - 1) {}

void MovingQuality::took(const Quality& quality, double pixels, bool new_pose, double seconds) {
  Known& known = known_[{quality, new_pose}];
  // The mean of this and what was known: one slow picture is no rule.
  known.seconds = known.pixels > 0 ? 0.5 * (known.seconds * pixels / known.pixels + seconds) : seconds;
  known.pixels = pixels;
}

double MovingQuality::expected(const Quality& quality, double pixels, bool new_pose) const {
  const auto seconds = [&](const Quality& asked, bool pose) -> double {
    const auto found = known_.find({asked, pose});
    return found == known_.end() ? -1 : found->second.seconds * pixels / found->second.pixels;
  };
  double factor = 1;
  for (auto at = std::find(choices_.begin(), choices_.end(), quality); at != choices_.end(); ++at) {
    if (*at != quality) factor *= at->preset == (at - 1)->preset ? std::pow(double(at->pixel_step) / (at - 1)->pixel_step, 2) : kNextPreset;
    // A new pose is more work, never less.
    const double fresh = seconds(*at, true), same = seconds(*at, false);
    if (new_pose && fresh >= 0) return factor * std::max(fresh, same);
    if (!new_pose && same >= 0) return factor * same;
    if (!new_pose && fresh >= 0) return factor * fresh;
    if (new_pose && same >= 0) return factor * same * 2;
  }
  return std::numeric_limits<double>::infinity();
}

Quality MovingQuality::choose(double pixels, bool new_pose, const std::string& finest) {
  const auto first = std::find(choices_.begin(), choices_.end(), Quality{finest, 1});
  for (size_t i = first == choices_.end() ? 0 : static_cast<size_t>(first - choices_.begin()); i < choices_.size(); ++i) {
    const double room = i < last_ ? 0.75 * budget_ : budget_;
    if (expected(choices_[i], pixels, new_pose) <= room || i + 1 == choices_.size()) {
      last_ = i;
      break;
    }
  }
  return choices_[last_];
}

}  // namespace arah
