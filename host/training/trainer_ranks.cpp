// The trainer on several ranks: what they add up before they take a step together.
#include <span>

#include "host/training/loss_slots.h"
#include "host/training/trainer.h"

namespace arah {

void Trainer::add_up_ranks(std::vector<PoseGradients>& pose_gradients) {
  commands_.submit_and_wait();
  const auto add_up = [&](const BufferSlice& slice, auto number) {
    auto values = device_.download<decltype(number)>(slice);
    ranks_.sum(std::span(values));
    device_.upload(slice, values);
  };
  const ParameterGroup& grid = networks_.layout().group("grid");
  add_up(networks_.gradients().elements(0, grid.begin), 0.0f);
  // In fixed point, whose sums have no rounding (kernels/color/feature_grid.h).
  if (grid.size() > 0) add_up(room_.updates.grid_sums().elements(0, grid.size()), uint32_t{0});
  add_up(room_.losses.slice().elements(0, loss_slots), 0.0f);
  for (PoseGradients& of_frame : pose_gradients) {
    ranks_.sum(std::span(of_frame.bones));
    ranks_.sum(std::span(of_frame.input));
  }
  ranks_.sum(std::span(noted_errors_));  // 0 where a ray is another rank's

  searches_ = searches();
  // What each watched alone. All of a rank's searches astray sends it to look for the reason in the state.
  const bool apart = !room_.watch.seen().empty() || (searches_.points > 0 && searches_.converged == 0);
  device_.download(room_.grid_clamped.slice().elements(0, 1), &grid_clamped_, 4);
  std::vector<double> counts;
  const auto each = [&](const auto& see) {
    for (uint64_t* count : {&shaded_samples_, &person_rays_, &person_hits_, &searches_.points, &searches_.steps, &searches_.converged, &searches_.diverged, &searches_.exhausted}) see(*count);
  };
  each([&](uint64_t count) { counts.push_back(double(count)); });
  counts.push_back(apart ? 1 : 0);
  counts.push_back(grid_clamped_);
  ranks_.sum(std::span(counts));
  auto next = counts.begin();
  each([&](uint64_t& count) { count = static_cast<uint64_t>(*next++); });
  found_apart_ = *next++ > 0;
  grid_clamped_ = static_cast<uint32_t>(*next);
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
