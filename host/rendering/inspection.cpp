#include "host/rendering/inspection.h"

#include <algorithm>

#include "kernels/compositing/samples.h"

namespace arah {

Inspection::Inspection(std::size_t pixels) : canonical(pixels, {0, 0, 0, 0}), placed(pixels, 0), wanted(pixels, 0), unfound(pixels, 0), shaded(pixels, 0), steps(pixels, 0), most_steps(pixels, 0) {}

Inspection Inspection::enlarged(int width, int height, int to_width, int to_height) const {
  Inspection large(static_cast<std::size_t>(to_width) * static_cast<std::size_t>(to_height));
  for (int64_t v = 0; v < to_height; ++v)
    for (int64_t u = 0; u < to_width; ++u) {
      const auto from = static_cast<std::size_t>(v * height / to_height * width + u * width / to_width), to = static_cast<std::size_t>(v * to_width + u);
      large.canonical[to] = canonical[from];
      large.placed[to] = placed[from];
      large.wanted[to] = wanted[from];
      large.unfound[to] = unfound[from];
      large.shaded[to] = shaded[from];
      large.steps[to] = steps[from];
      large.most_steps[to] = most_steps[from];
    }
  return large;
}

void RayInspector::note_placed(Device& device, Commands& commands, RaySamples& samples, uint32_t rays) {
  commands.submit_and_wait();
  const uint64_t bytes = samples.rows(rays) * 16ull;
  rays_ = rays;
  samples_ = samples.samples();
  points_ = device.download<std::array<float, 4>>(samples.points().sub(0, bytes));
  canonical_ = device.download<std::array<float, 4>>(samples.canonical().sub(0, bytes));
  steps_ = samples.root_finder().searches() && !samples.opaque() ? samples.root_finder().steps() : std::vector<uint32_t>{};
}

void RayInspector::note_shaded(Device& device, ShadedRays& shaded, const std::vector<uint32_t>& pixels, int width, Inspection& inspection) {
  const uint64_t rows = uint64_t(rays_) * samples_;
  const auto weights = device.download<float>(shaded.weights().elements(0, rows));
  const auto slots = device.download<uint32_t>(shaded.queue().slots().elements(0, rows));
  for (std::size_t ray = 0; ray < rays_; ++ray) {
    const std::size_t pixel = pixel_index(pixels[ray], width);
    double sum = 0;
    std::array<double, 3> place{};
    for (std::size_t row = ray * samples_; row < (ray + 1) * samples_; ++row) {
      const bool wanted = points_[row][3] > 0;
      inspection.placed[pixel] += points_[row][3] != 0;
      inspection.wanted[pixel] += wanted;
      inspection.unfound[pixel] += wanted && canonical_[row][3] == 0;
      inspection.shaded[pixel] += slots[row] != no_slot;
      if (wanted && !steps_.empty()) {
        inspection.steps[pixel] += steps_[row];
        inspection.most_steps[pixel] = std::max(inspection.most_steps[pixel], steps_[row]);
      }
      if (canonical_[row][3] <= 0) continue;
      sum += double{weights[row]};
      for (std::size_t i = 0; i < 3; ++i) place[i] += double{weights[row]} * double{canonical_[row][i]};
    }
    if (sum <= 0) continue;
    for (std::size_t i = 0; i < 3; ++i) inspection.canonical[pixel][i] = static_cast<float>(place[i] / sum);
    inspection.canonical[pixel][3] = static_cast<float>(std::min(sum, 1.0));
  }
}

}  // namespace arah
