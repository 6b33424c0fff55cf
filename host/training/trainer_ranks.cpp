// The trainer on several ranks: what they add up before they take a step together. Per frame that is the gradients at the effective
// weights, so that what lies behind these (FiLM, a low-rank change by the pose, a hypernetwork's outer products) is done on all
// ranks alike and its 85 million gradients never travel.
#include <chrono>
#include <span>

#include "host/training/loss_slots.h"
#include "host/training/trainer.h"

namespace arah {
namespace {

double elapsed(std::chrono::steady_clock::time_point start) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); }

// `layers` one behind the other in `flat`, from its float `first` on, or back from there. Returns how many floats that is.
uint64_t record_flat(Commands& commands, const std::vector<BufferSlice>& layers, const BufferSlice& flat, uint64_t first, bool back) {
  uint64_t floats = 0;
  for (const BufferSlice& layer : layers) {
    const BufferSlice there = flat.elements(first + floats, layer.bytes / 4);
    if (back) commands.copy(there, layer);
    else commands.copy(layer, there);
    floats += layer.bytes / 4;
  }
  return floats;
}

constexpr AvatarNetworks::Parts of_color{.sdf = false, .skinning = false, .color = true};

}  // namespace

void Trainer::take_passes(bool last_frame) {
  const BufferSlice flat = room_.exchange.slice();
  const uint64_t floats = record_flat(commands_, networks_.effective_gradients(of_color), flat, 0, false);
  commands_.submit_and_wait();
  of_passes_ = {device_.download<float>(flat.elements(0, floats)), {}};
  // In fixed point, whose sums have no rounding (kernels/color/feature_grid.h).
  const uint64_t grid = last_frame ? networks_.layout().group("grid").size() : 0;
  if (grid > 0) of_passes_.grid = device_.download<uint32_t>(room_.updates.grid_sums().elements(0, grid));
}

void Trainer::add_up_frame(bool skinning_step) {
  if (exchange_beside_) commands_.submit();
  else commands_.submit_and_wait();
  auto start = std::chrono::steady_clock::now();
  ranks_.sum(std::span(of_passes_.color));
  ranks_.sum(std::span(of_passes_.grid));
  if (exchange_beside_) exchange_.beside += elapsed(start);
  exchange_.seconds += elapsed(start);
  commands_.wait();

  const BufferSlice flat = room_.exchange.slice();
  const AvatarNetworks::Parts rest{.sdf = true, .skinning = skinning_step, .color = false};
  const uint64_t first = of_passes_.color.size();
  const uint64_t floats = record_flat(commands_, networks_.effective_gradients(rest), flat, first, false);
  commands_.submit_and_wait();
  std::vector<float> values = device_.download<float>(flat.elements(first, floats));
  start = std::chrono::steady_clock::now();
  ranks_.sum(std::span(values));
  exchange_.seconds += elapsed(start);
  exchange_.bytes += 4 * (of_passes_.color.size() + of_passes_.grid.size() + values.size());

  device_.upload(flat, of_passes_.color);
  device_.upload(flat.elements(first, floats), values);
  if (!of_passes_.grid.empty()) device_.upload(room_.updates.grid_sums(), of_passes_.grid);
  record_flat(commands_, networks_.effective_gradients(of_color), flat, 0, true);
  record_flat(commands_, networks_.effective_gradients(rest), flat, first, true);
}

void Trainer::add_up_step(std::vector<PoseGradients>& pose_gradients) {
  commands_.submit_and_wait();
  download_counts();
  // What each watched alone. All of a rank's searches astray sends it to look for the reason in the state.
  const bool apart = !room_.watch.seen().empty() || (searches_.points > 0 && searches_.converged == 0);
  auto losses = device_.download<float>(room_.losses.slice().elements(0, loss_slots));
  auto b = device_.download<float>(networks_.gradient("b").elements(0, 1));

  std::vector<double> numbers;
  const auto each = [&](const auto& see) {
    for (uint32_t slot = 0; slot < loss_slots; ++slot)
      if (slot != parameter_slot) see(losses[slot]);  // the size of the parameters is no ray's: all have found it alike
    see(b[0]);
    for (PoseGradients& of_frame : pose_gradients)
      for (float& bone : of_frame.bones) see(bone);
    for (double& error : noted_errors_) see(error);  // 0 where a ray is another rank's
    for (uint64_t* count : {&shaded_samples_, &person_rays_, &person_hits_, &searches_.points, &searches_.steps, &searches_.converged, &searches_.diverged, &searches_.exhausted}) see(*count);
    for (uint32_t* count : {&implicit_counts_.singular, &implicit_counts_.shortened, &grid_clamped_}) see(*count);
  };
  each([&](const auto& number) { numbers.push_back(static_cast<double>(number)); });
  numbers.push_back(apart ? 1 : 0);
  const auto start = std::chrono::steady_clock::now();
  ranks_.sum(std::span(numbers));
  exchange_.seconds += elapsed(start);
  exchange_.bytes += 8 * numbers.size();
  auto next = numbers.begin();
  each([&](auto& number) { number = static_cast<std::remove_reference_t<decltype(number)>>(*next++); });
  found_apart_ = *next > 0;
  device_.upload(room_.losses.slice(), losses);
  device_.upload(networks_.gradient("b"), b);
}

void Trainer::follow_first() {
  const BufferSlice parameters = networks_.parameters().elements(0, networks_.layout().floats);
  auto values = device_.download<float>(parameters);
  const auto start = std::chrono::steady_clock::now();
  ranks_.broadcast(std::span(values));
  exchange_.seconds += elapsed(start);
  exchange_.bytes += 4 * values.size();
  if (!ranks_.first()) device_.upload(parameters, values);
}

BadValues Trainer::of_all_ranks(const BadValues& found) {
  if (!found_apart_) return found;
  SafetensorsFile file;
  put_bad_values(file, found);
  const auto& [key, text] = *file.metadata.begin();
  // The rank that looked closest: of a number that spreads, the others see what it became. Of several the first.
  BadValues most;
  for (const std::string& other : ranks_.gather(text)) {
    SafetensorsFile of_rank;
    of_rank.metadata[key] = other;
    BadValues bad = *bad_values_of(of_rank);
    if (bad.tensors.size() > most.tensors.size()) most = std::move(bad);
  }
  return most;
}

}  // namespace arah
