#include "host/training/parameter_updates.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "kernels/optimizer/clip_scale.h"
#include "kernels/optimizer/sum_of_squares.h"

namespace arah {

ParameterUpdates::ParameterUpdates(Device& device, AvatarNetworks& networks, const TrainingSettings& settings) : device_(device), networks_(networks), settings_(settings) {
  const std::map<std::string, const GroupSettings*> by_name{{"sdf", &settings.sdf},       {"mapping", &settings.mapping},     {"skinning", &settings.skinning}, {"color", &settings.color},
                                                            {"latent", &settings.latent}, {"deviation", &settings.deviation}, {"grid", &settings.grid},         {"pose_code", &settings.pose_code},
                                                            {"hyper", &settings.hyper},   {"low_rank", &settings.low_rank},   {"hyper_last", &settings.hyper_last}};
  const ParameterLayout& layout = networks.layout();
  for (const ParameterGroup& group : layout.groups) groups_.push_back({group.name, by_name.at(group.name), group.begin, group.end, 0});
  auto make = [&](const char* what, uint64_t bytes, BufferPlace place = BufferPlace::device) {
    Buffer buffer(device, std::string("training: ") + what, bytes, place);
    Commands commands(device);
    commands.fill(buffer.slice(), 0);
    commands.submit_and_wait();
    return buffer;
  };
  first_moments_ = make("first moments", layout.floats * 4);
  second_moments_ = make("second moments", layout.floats * 4);
  averages_ = make("averaged parameters", layout.floats * 4);
  grid_sums_ = make("sums of the grid's gradient", std::max<uint64_t>(layout.group("grid").size() * 4, 256));
  squares_ = make("partial sums of squares", squares_partials(layout.floats) * sizeof(shared::SquaresPartial));
  norms_ = make("norms of gradients", layout.groups.size() * sizeof(shared::GradientNorm), BufferPlace::shared);
}

void ParameterUpdates::start(const std::vector<float>& parameters) { device_.upload(averages_.slice(), parameters); }

void ParameterUpdates::record_norms(Commands& commands, bool skinning) {
  for (size_t g = 0; g < groups_.size(); ++g) {
    Group& group = groups_[g];
    // The grid's sums are integers, to which no contribution that is not finite is added.
    group.watched = group.begin != group.end && group.name != "grid" && (group.name != "skinning" || skinning);
    if (!group.watched) continue;
    uint32_t partials = 0;
    if (group.name == "hyper_last") {
      for (const AvatarNetworks::LastGradient& part : networks_.hyper_last_gradients(settings_.frames_per_step)) {
        record_outer_norm(commands, part.product, squares_.slice(), partials);
        partials += outer_partials(settings_.frames_per_step);
      }
    } else {
      const uint64_t count = group.end - group.begin;
      record_sum_of_squares(commands, {networks_.gradients().elements(group.begin, count), squares_.slice(), 0});
      partials = squares_partials(count);
    }
    record_clip_scale(commands, {partials, squares_.slice(), static_cast<float>(group.settings->max_norm), norms_.slice(), static_cast<uint32_t>(g)});
  }
}

void ParameterUpdates::record(Commands& commands, uint64_t step, double done, bool skinning) {
  for (size_t g = 0; g < groups_.size(); ++g) {
    Group& group = groups_[g];
    if (group.begin == group.end || (group.name == "skinning" && !skinning)) continue;
    const double factor = rate_factor(*group.settings, settings_, step, done);
    if (factor > 0) group.updates += 1;
    if (group.name == "hyper_last") record_hyper_last(commands, group, g, factor);
    else record_group(commands, group, g, factor);
  }
}

AdamArgs ParameterUpdates::adam_args(const Group& group, size_t index, double factor, uint64_t first, uint64_t count) {
  AdamArgs adam;
  adam.step = static_cast<uint32_t>(group.updates);
  adam.rate = group.settings->rate * factor;
  adam.weight_decay = group.settings->weight_decay;
  // A short memory at first: the average must not hold on to where it started.
  adam.average_decay = std::min(settings_.average_decay, double(1 + group.updates) / double(10 + group.updates));
  adam.parameters = networks_.parameters().elements(first, count);
  adam.first_moments = first_moments_.slice().elements(first, count);
  adam.second_moments = second_moments_.slice().elements(first, count);
  adam.averages = averages_.slice().elements(first, count);
  adam.norms = norms_.slice();
  adam.norm_index = static_cast<uint32_t>(index);
  return adam;
}

void ParameterUpdates::record_group(Commands& commands, Group& group, size_t index, double factor) {
  const bool grid = group.name == "grid";
  const uint64_t count = group.end - group.begin;
  const BufferSlice gradients = grid ? grid_sums_.slice().elements(0, count) : networks_.gradients().elements(group.begin, count);
  if (factor == 0) {
    if (grid) commands.fill(grid_sums_.slice(), 0);
    return;
  }
  AdamArgs adam = adam_args(group, index, factor, group.begin, count);
  adam.gradients = gradients;
  if (grid) {
    adam.norms = {};
    adam.lazy = true;
    adam.gradient_unit = 1.0f / grid_scale();
  }
  record_adam(commands, adam);
}

void ParameterUpdates::record_hyper_last(Commands& commands, Group& group, size_t index, double factor) {
  if (factor == 0) return;
  for (const AvatarNetworks::LastGradient& part : networks_.hyper_last_gradients(settings_.frames_per_step)) {
    AdamArgs adam = adam_args(group, index, factor, part.slot.offset, (part.slot.count + kSlotAlignment - 1) / kSlotAlignment * kSlotAlignment);
    adam.outer = part.product;
    record_adam(commands, adam);
  }
}

std::optional<BadTensor> ParameterUpdates::first_bad(const std::vector<float>& values, uint64_t first, double limit) const {
  BadTensor bad;
  bad.limit = limit;
  const ParameterLayout& layout = networks_.layout();
  for (const TensorSlot& slot : layout.slots) {
    if (slot.offset < first || slot.offset + slot.count > first + values.size()) continue;
    for (uint64_t i = 0; i < slot.count; ++i) {
      const float value = values[slot.offset - first + i];
      if (std::isfinite(value) && !(limit > 0 && std::abs(value) > limit)) continue;
      bad.nan += std::isnan(value);
      bad.infinite += std::isinf(value);
      bad.beyond += std::isfinite(value);
      if (!bad.place.empty()) continue;
      const auto group = std::find_if(layout.groups.begin(), layout.groups.end(), [&](const ParameterGroup& g) { return slot.offset >= g.begin && slot.offset < g.end; });
      bad.index = i;
      bad.place = fmt::format("number {} of tensor '{}' of {} in group '{}'", i, slot.name, fmt::join(slot.shape, " x "), group->name);
    }
  }
  if (bad.place.empty()) return std::nullopt;
  return bad;
}

std::vector<BadTensor> ParameterUpdates::bad_gradients() {
  const auto norms = device_.download<shared::GradientNorm>(norms_.slice().sub(0, groups_.size() * sizeof(shared::GradientNorm)));
  std::vector<BadTensor> found;
  for (size_t g = 0; g < groups_.size(); ++g) {
    const Group& group = groups_[g];
    if (!group.watched || norms[g].usable) continue;
    BadTensor bad;
    if (group.name == "hyper_last") {  // outer products that are nowhere written out
      bad.infinite = norms[g].nonfinite;
      bad.place = fmt::format("a product of two vectors of the hypernetwork, in group '{}'", group.name);
    } else {
      const uint64_t count = group.end - group.begin;
      // Where finite numbers have a norm whose square is not, one of 10⁸ is beyond this.
      bad = first_bad(device_.download<float>(networks_.gradients().elements(group.begin, count)), group.begin, norms[g].nonfinite ? 0 : 1e15).value_or(bad);
    }
    bad.stage = "optimiser";
    bad.tensor = fmt::format("gradient of '{}'", group.name);
    found.push_back(bad);
  }
  return found;
}

std::vector<BadTensor> ParameterUpdates::bad_state() {
  const uint64_t floats = networks_.layout().floats;
  std::vector<BadTensor> found;
  for (const auto& [name, slice] : {std::pair{"parameters", networks_.parameters()}, {"averaged parameters", averages_.slice()}, {"first moments", first_moments_.slice()}, {"second moments", second_moments_.slice()}}) {
    std::optional<BadTensor> bad = first_bad(device_.download<float>(slice.elements(0, floats)), 0, 0);
    if (!bad) continue;
    bad->stage = "weights";
    bad->tensor = name;
    found.push_back(*bad);
  }
  return found;
}

double ParameterUpdates::sdf_norm() { return device_.download<shared::GradientNorm>(norms_.slice().sub(0, sizeof(shared::GradientNorm)))[0].norm; }

void ParameterUpdates::save(SafetensorsFile& file) {
  const uint64_t floats = networks_.layout().floats;
  auto put = [&](const char* name, const BufferSlice& slice) { file.tensors[name] = Tensor::from<float>({static_cast<int64_t>(floats)}, device_.download<float>(slice.elements(0, floats))); };
  put("optimizer.parameters", networks_.parameters());
  put("optimizer.averages", averages_.slice());
  put("optimizer.first_moments", first_moments_.slice());
  put("optimizer.second_moments", second_moments_.slice());
  std::vector<int64_t> updates;
  for (const Group& group : groups_) updates.push_back(static_cast<int64_t>(group.updates));
  file.tensors["optimizer.updates"] = Tensor::from<int64_t>({static_cast<int64_t>(updates.size())}, updates);
}

void ParameterUpdates::load(const SafetensorsFile& file) {
  const auto floats = static_cast<int64_t>(networks_.layout().floats);
  auto take = [&](const char* name, const BufferSlice& slice) { device_.upload(slice, file.values<float>(name, {floats})); };
  take("optimizer.parameters", networks_.parameters());
  take("optimizer.averages", averages_.slice());
  take("optimizer.first_moments", first_moments_.slice());
  take("optimizer.second_moments", second_moments_.slice());
  const auto updates = file.values<int64_t>("optimizer.updates", {static_cast<int64_t>(groups_.size())});
  for (size_t g = 0; g < groups_.size(); ++g) groups_[g].updates = static_cast<uint64_t>(updates[g]);
}

}  // namespace arah
