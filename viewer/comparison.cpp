#include "viewer/comparison.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "host/evaluation/evaluate.h"
#include "host/evaluation/image_metrics.h"
#include "host/evaluation/picture.h"

namespace arah {
namespace {

std::size_t pixels_of(const Picture& picture) {
  const std::size_t pixels = static_cast<std::size_t>(std::max(picture.width, 0)) * static_cast<std::size_t>(std::max(picture.height, 0));
  if (pixels == 0 || picture.color.size() != 3 * pixels || picture.alpha.size() != pixels)
    throw std::invalid_argument(fmt::format("a rendering of {} x {} with {} colours and {} alphas", picture.width, picture.height, picture.color.size() / 3, picture.alpha.size()));
  return pixels;
}

void check_photograph(const Picture& rendering, const Image& photograph) {
  if (photograph.width != rendering.width || photograph.height != rendering.height || photograph.rgba.size() != 4 * rendering.alpha.size())
    throw std::invalid_argument(fmt::format("a photograph of {} x {} for a rendering of {} x {}", photograph.width, photograph.height, rendering.width, rendering.height));
}

// Premultiplied colours and alphas, as Picture has them, to straight bytes.
Rgba8 straight_bytes(const std::vector<float>& color, const std::vector<float>& alpha, int width, int height) {
  return {width, height, eight_bits(straight_alpha(color, alpha, width, height), width, height, 4)};
}

}  // namespace

bool blink_shows_photograph(const Comparison& comparison, double time) {
  const double period = std::clamp(comparison.period, kShortestBlink, kLongestBlink);
  const double phase = std::isfinite(time) ? std::fmod(time, period) / period : 0.0;
  return (phase < 0 ? phase + 1 : phase) >= 0.5;
}

Rgba8 compared(const Picture& rendering, const Image* photograph, const Comparison& comparison, double time) {
  const std::size_t pixels = pixels_of(rendering);
  if (photograph == nullptr || comparison.mode == ComparisonMode::off) return straight_bytes(rendering.color, rendering.alpha, rendering.width, rendering.height);
  check_photograph(rendering, *photograph);
  if (comparison.mode == ComparisonMode::error_map) {
    const auto gain = static_cast<float>(std::clamp(comparison.gain, kLeastErrorGain, kLargestErrorGain));
    const std::vector<float> map = error_map(rendering.color, rgb_on_black(*photograph), rendering.width, rendering.height, gain);
    return straight_bytes(map, std::vector<float>(pixels, 1.0f), rendering.width, rendering.height);
  }
  const double border = std::clamp(comparison.position, 0.0, 1.0) * rendering.width;  // pixel columns are shown from x to x + 1
  const bool blinked = comparison.mode == ComparisonMode::blink && blink_shows_photograph(comparison, time);
  std::vector<float> color(rendering.color), alpha(rendering.alpha);
  for (std::size_t i = 0; i < pixels; ++i) {
    // Shares of both in this pixel, one over the other.
    float drawn = 1, behind = 0;
    if (comparison.mode == ComparisonMode::behind) behind = std::clamp(1.0f - rendering.alpha[i], 0.0f, 1.0f);
    if (comparison.mode == ComparisonMode::blink) drawn = blinked ? 0.0f : 1.0f, behind = 1 - drawn;
    if (comparison.mode == ComparisonMode::split) drawn = static_cast<double>(i % static_cast<std::size_t>(rendering.width)) + 0.5 < border ? 0.0f : 1.0f, behind = 1 - drawn;
    const float* photographed = &photograph->rgba[4 * i];
    const auto mixed = [&](float a, float b) { return (drawn > 0 ? drawn * a : 0.0f) + (behind > 0 ? behind * b : 0.0f); };
    for (std::size_t c = 0; c < 3; ++c) color[3 * i + c] = mixed(rendering.color[3 * i + c], photographed[c]);
    alpha[i] = mixed(rendering.alpha[i], photographed[3]);
  }
  return straight_bytes(color, alpha, rendering.width, rendering.height);
}

std::optional<double> compared_psnr(const Picture& rendering, const Image& photograph, const PixelMask& mask) {
  const std::size_t pixels = pixels_of(rendering);
  check_photograph(rendering, photograph);
  if (mask.width != rendering.width || mask.height != rendering.height || mask.inside.size() != pixels)
    throw std::invalid_argument(fmt::format("a mask of {} x {} for a rendering of {} x {}", mask.width, mask.height, rendering.width, rendering.height));
  const std::vector<float> truth = rgb_on_black(photograph);
  bool any = false;
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!mask.inside[i]) continue;
    any = true;
    for (std::size_t c = 3 * i; c < 3 * i + 3; ++c)
      if (!std::isfinite(rendering.color[c]) || !std::isfinite(truth[c])) return std::nullopt;
  }
  if (!any) return std::nullopt;
  return psnr({rendering.color, rendering.width, rendering.height}, {truth, rendering.width, rendering.height}, mask.inside);
}

}  // namespace arah
