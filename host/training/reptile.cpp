#include "host/training/reptile.h"

#include <fmt/format.h>

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

void Reptile::record_update(Commands& commands, std::size_t index, std::vector<Moments>& moments, uint32_t step, double rate) {
  const ReptileGroup& group = groups_[index];
  const uint64_t count = group.end - group.begin;
  AdamArgs adam;
  adam.step = step;
  adam.rate = rate;
  adam.parameters = parameters_.elements(group.begin, count);
  adam.gradients = gradients_.elements(group.begin, count);
  adam.first_moments = moments[index].first.slice();
  adam.second_moments = moments[index].second.slice();
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
  std::vector<std::vector<double>> direction;
  for (const std::vector<float>& values : start) direction.emplace_back(values.size(), 0.0);
  Commands commands(device_);
  for (const std::size_t task : tasks) {
    for (Moments& moments : inner_) {
      commands.fill(moments.first.slice(), 0);
      commands.fill(moments.second.slice(), 0);
    }
    for (uint32_t step = 0; step < inner_steps_; ++step) {
      commands.fill(gradients_, 0);
      gradients(commands, task, step);
      for (std::size_t g = 0; g < groups_.size(); ++g) record_update(commands, g, inner_, step + 1, groups_[g].inner_rate);
      commands.submit_and_wait();
    }
    const std::vector<std::vector<float>> end = download_parameters();
    upload_parameters(start);
    for (std::size_t g = 0; g < groups_.size(); ++g)
      for (std::size_t i = 0; i < end[g].size(); ++i) {
        if (!std::isfinite(end[g][i])) throw std::runtime_error(fmt::format("pre-training: the group '{}' became not finite in outer step {}", groups_[g].name, steps_ + 1));
        direction[g][i] += (double{start[g][i]} - double{end[g][i]}) / static_cast<double>(tasks.size());
      }
  }
  ++steps_;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    device_.upload(gradients_.elements(groups_[g].begin, groups_[g].end - groups_[g].begin), std::vector<float>(direction[g].begin(), direction[g].end()));
    record_update(commands, g, outer_, static_cast<uint32_t>(steps_), outer_factor * groups_[g].outer_rate);
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
