#include "host/evaluation/bad_pixels.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>

namespace arah {
namespace {

bool all_finite(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); });
}

}  // namespace

BadPixels bad_pixels(const Picture& picture) {
  BadPixels bad{0, picture.alpha.size(), 0, 0};
  for (std::size_t i = 0; i < picture.alpha.size(); ++i) {
    if (std::isfinite(picture.alpha[i]) && std::isfinite(picture.depth[i]) && all_finite({&picture.color[3 * i], 3}) && (picture.normal.empty() || all_finite({&picture.normal[3 * i], 3}))) continue;
    const auto width = static_cast<std::size_t>(picture.width);
    if (bad.count++ == 0) bad.column = static_cast<int>(i % width), bad.row = static_cast<int>(i / width);
  }
  return bad;
}

bool finite_colors(const Picture& picture, const CropRectangle& crop) {
  for (int y = crop.y0; y < crop.y1; ++y) {
    const std::size_t first = 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) + static_cast<std::size_t>(crop.x0));
    if (!all_finite({&picture.color[first], 3 * static_cast<std::size_t>(crop.x1 - crop.x0)})) return false;
  }
  return true;
}

std::string counted(const BadPixels& bad) {
  return fmt::format("{} of {} pixels are not finite, the first in column {} of row {}", bad.count, bad.pixels, bad.column, bad.row);
}

std::string warning_of(const BadPixels& bad, const std::string& picture, const std::string& avatar) {
  return fmt::format("warning: {}: {} (magenta in colours); 'arah inspect {}' names the tensor with the largest number", picture, counted(bad), avatar);
}

}  // namespace arah
