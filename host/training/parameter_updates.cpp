#include "host/training/parameter_updates.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <stdexcept>

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
  if (!grid) {
    record_sum_of_squares(commands, {gradients, squares_.slice(), 0});
    record_clip_scale(commands, {squares_partials(count), squares_.slice(), static_cast<float>(group.settings->max_norm), norms_.slice(), static_cast<uint32_t>(index)});
  }
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
  const uint32_t frames = settings_.frames_per_step;
  const std::vector<AvatarNetworks::LastGradient> parts = networks_.hyper_last_gradients(frames);
  uint32_t partials = 0;
  for (const AvatarNetworks::LastGradient& part : parts) {
    record_outer_norm(commands, part.product, squares_.slice(), partials);
    partials += outer_partials(frames);
  }
  record_clip_scale(commands, {partials, squares_.slice(), static_cast<float>(group.settings->max_norm), norms_.slice(), static_cast<uint32_t>(index)});
  if (factor == 0) return;
  for (const AvatarNetworks::LastGradient& part : parts) {
    AdamArgs adam = adam_args(group, index, factor, part.slot.offset, (part.slot.count + kSlotAlignment - 1) / kSlotAlignment * kSlotAlignment);
    adam.outer = part.product;
    record_adam(commands, adam);
  }
}

void ParameterUpdates::check(uint64_t step) {
  const auto norms = device_.download<shared::GradientNorm>(norms_.slice().sub(0, groups_.size() * sizeof(shared::GradientNorm)));
  for (size_t g = 0; g < groups_.size(); ++g)
    if (norms[g].nonfinite)
      throw std::runtime_error(fmt::format("training step {}: {} numbers of the gradient of '{}' are NaN or infinite", step, norms[g].nonfinite, groups_[g].name));
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
