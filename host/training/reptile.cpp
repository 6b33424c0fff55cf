#include "host/training/reptile.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <stdexcept>

#include "host/input_error.h"
#include "kernels/optimizer/adam.h"

namespace arah {

Reptile::Reptile(Device& device, const BufferSlice& parameters, const BufferSlice& gradients, std::vector<ReptileGroup> groups, uint32_t inner_steps)
    : device_(device), parameters_(parameters), gradients_(gradients), groups_(std::move(groups)), inner_steps_(inner_steps) {
  if (inner_steps == 0) throw std::invalid_argument("reptile: no inner steps");
  inner_ = make_moments("inner");
  outer_ = make_moments("outer");
  Commands zero(device);
  for (Moments& moments : outer_) {
    zero.fill(moments.first.slice(), 0);
    zero.fill(moments.second.slice(), 0);
  }
  zero.submit_and_wait();
}

std::vector<Reptile::Moments> Reptile::make_moments(const std::string& which) const {
  std::vector<Moments> all;
  for (const ReptileGroup& group : groups_) {
    const uint64_t bytes = (group.end - group.begin) * 4;
    all.push_back({Buffer(device_, fmt::format("reptile: {} first moments of {}", which, group.name), bytes, BufferPlace::device),
                   Buffer(device_, fmt::format("reptile: {} second moments of {}", which, group.name), bytes, BufferPlace::device)});
  }
  return all;
}

void Reptile::record_inner_update(Commands& commands, std::size_t index, uint32_t step) {
  const ReptileGroup& group = groups_[index];
  const auto update = [&](uint64_t begin, uint64_t end) {
    AdamArgs adam;
    adam.step = step;
    adam.rate = group.inner_rate;
    adam.parameters = parameters_.elements(begin, end - begin);
    adam.first_moments = inner_[index].first.slice().elements(begin - group.begin, end - begin);
    adam.second_moments = inner_[index].second.slice().elements(begin - group.begin, end - begin);
    return adam;
  };
  if (!group.outer_gradients) {
    AdamArgs adam = update(group.begin, group.end);
    adam.gradients = gradients_.elements(group.begin, group.end - group.begin);
    record_adam(commands, adam);
    return;
  }
  for (const OuterGradient& part : group.outer_gradients()) {
    AdamArgs adam = update(part.begin, part.end);
    adam.outer = part.product;
    record_adam(commands, adam);
  }
}

// The gradient lies where the inner steps had their first moments: a group may have no other place for it.
void Reptile::record_outer_update(Commands& commands, std::size_t index, double rate) {
  const ReptileGroup& group = groups_[index];
  AdamArgs adam;
  adam.step = static_cast<uint32_t>(steps_);
  adam.rate = rate;
  adam.parameters = parameters_.elements(group.begin, group.end - group.begin);
  adam.gradients = inner_[index].first.slice();
  adam.first_moments = outer_[index].first.slice();
  adam.second_moments = outer_[index].second.slice();
  record_adam(commands, adam);
}

std::vector<std::vector<float>> Reptile::download_parameters() const {
  std::vector<std::vector<float>> values;
  for (const ReptileGroup& group : groups_) values.push_back(device_.download<float>(parameters_.elements(group.begin, group.end - group.begin)));
  return values;
}

void Reptile::upload_parameters(const std::vector<std::vector<float>>& values) const {
  for (std::size_t g = 0; g < groups_.size(); ++g) device_.upload(parameters_.elements(groups_[g].begin, groups_[g].end - groups_[g].begin), values[g]);
}

void Reptile::step(std::span<const std::size_t> tasks, const TaskGradients& gradients, double outer_factor) {
  if (tasks.empty()) throw std::invalid_argument("reptile: a step without tasks");
  const std::vector<std::vector<float>> start = download_parameters();
  std::vector<std::vector<std::vector<float>>> ends;  // by task and group
  Commands commands(device_);
  for (const std::size_t task : tasks) {
    for (Moments& moments : inner_) {
      commands.fill(moments.first.slice(), 0);
      commands.fill(moments.second.slice(), 0);
    }
    for (uint32_t step = 0; step < inner_steps_; ++step) {
      commands.fill(gradients_, 0);
      gradients(commands, task, step);
      for (std::size_t g = 0; g < groups_.size(); ++g) record_inner_update(commands, g, step + 1);
      commands.submit_and_wait();
    }
    ends.push_back(download_parameters());
    upload_parameters(start);
    for (std::size_t g = 0; g < groups_.size(); ++g)
      if (!std::ranges::all_of(ends.back()[g], [](float value) { return std::isfinite(value); }))
        throw std::runtime_error(fmt::format("pre-training: the group '{}' became not finite in outer step {}", groups_[g].name, steps_ + 1));
  }
  ++steps_;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    std::vector<float>& mean = ends.front()[g];  // of start − end, in place of the first task's end
    for (std::size_t i = 0; i < mean.size(); ++i) {
      double sum = 0;
      for (const auto& end : ends) sum += (double{start[g][i]} - double{end[g][i]}) / static_cast<double>(tasks.size());
      mean[i] = static_cast<float>(sum);
    }
    device_.upload(inner_[g].first.slice(), mean);
    record_outer_update(commands, g, outer_factor * groups_[g].outer_rate);
  }
  commands.submit_and_wait();
}

void Reptile::save(SafetensorsFile& file) {
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const std::string prefix = "reptile." + groups_[g].name + ".";
    const std::vector<int64_t> shape{static_cast<int64_t>(groups_[g].end - groups_[g].begin)};
    file.tensors[prefix + "first_moments"] = Tensor::from<float>(shape, device_.download<float>(outer_[g].first.slice()));
    file.tensors[prefix + "second_moments"] = Tensor::from<float>(shape, device_.download<float>(outer_[g].second.slice()));
    file.metadata[prefix + "steps"] = std::to_string(steps_);
  }
}

void Reptile::load(const SafetensorsFile& file) {
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const std::string prefix = "reptile." + groups_[g].name + ".";
    const std::vector<int64_t> shape{static_cast<int64_t>(groups_[g].end - groups_[g].begin)};
    device_.upload(outer_[g].first.slice(), file.values<float>(prefix + "first_moments", shape));
    device_.upload(outer_[g].second.slice(), file.values<float>(prefix + "second_moments", shape));
    const auto found = file.metadata.find(prefix + "steps");
    const std::string digits = found == file.metadata.end() ? "none" : found->second;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), steps_);
    if (error != std::errc() || end != digits.data() + digits.size()) throw InputError(file.path.string(), "metadata " + prefix + "steps", "a whole number", "'" + digits + "'");
  }
}

}  // namespace arah
