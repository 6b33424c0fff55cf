#include "host/evaluation/image_metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

namespace arah {
namespace {

std::size_t pixel_count(int width, int height) {
  if (width < 1 || height < 1) {
    throw std::invalid_argument(fmt::format("picture: expected at least 1x1 pixels, found {}x{}", width, height));
  }
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

void check_pair(const RgbPicture& rendering, const RgbPicture& truth) {
  if (rendering.width != truth.width || rendering.height != truth.height) {
    throw std::invalid_argument(
        fmt::format("pictures: expected equal sizes, found a rendering of {}x{} and a truth of {}x{}", rendering.width,
                    rendering.height, truth.width, truth.height));
  }
  const std::size_t numbers = 3 * pixel_count(truth.width, truth.height);
  if (rendering.rgb.size() != numbers || truth.rgb.size() != numbers) {
    throw std::invalid_argument(fmt::format("pictures of {}x{}: expected {} numbers each, found {} and {}", truth.width,
                                            truth.height, numbers, rendering.rgb.size(), truth.rgb.size()));
  }
}

void check_mask(std::span<const std::uint8_t> mask, int width, int height) {
  if (mask.size() != pixel_count(width, height)) {
    throw std::invalid_argument(fmt::format("mask of a {}x{} picture: expected {} bytes, found {}", width, height,
                                            pixel_count(width, height), mask.size()));
  }
}

// A sum over pixels is finite exactly when every term is, for values that float can hold.
double require_finite(double value) {
  if (!std::isfinite(value))
    throw std::invalid_argument("pictures: expected finite values, found a NaN or an infinity");
  return value;
}

// What SSIM needs of a set of pixel pairs: sums of x, y, x^2, y^2 and x*y.
struct Moments {
  double x = 0;
  double y = 0;
  double xx = 0;
  double yy = 0;
  double xy = 0;
  void add(const Moments& other) {
    x += other.x;
    y += other.y;
    xx += other.xx;
    yy += other.yy;
    xy += other.xy;
  }
};

}  // namespace

CropRectangle mask_bounds(std::span<const std::uint8_t> mask, int width, int height) {
  check_mask(mask, width, height);
  CropRectangle box{width, height, 0, 0};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (mask[static_cast<std::size_t>(y) * width + x] == 0) continue;
      box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1), std::max(box.y1, y + 1)};
    }
  }
  if (box.x1 == 0) throw std::invalid_argument("mask: expected at least one pixel inside, found none");
  return box;
}

double mean_squared_error(const RgbPicture& rendering, const RgbPicture& truth, std::span<const std::uint8_t> mask) {
  check_pair(rendering, truth);
  check_mask(mask, truth.width, truth.height);
  double sum = 0;
  std::size_t pixels = 0;
  for (std::size_t pixel = 0; pixel < mask.size(); ++pixel) {
    if (mask[pixel] == 0) continue;
    ++pixels;
    for (std::size_t i = 3 * pixel; i < 3 * pixel + 3; ++i) {
      const double difference = static_cast<double>(rendering.rgb[i]) - static_cast<double>(truth.rgb[i]);
      sum += difference * difference;
    }
  }
  if (pixels == 0) throw std::invalid_argument("mask: expected at least one pixel inside, found none");
  return require_finite(sum) / (3.0 * static_cast<double>(pixels));
}

double psnr(double mse) {
  if (!(mse >= 0)) throw std::invalid_argument(fmt::format("mean squared error: expected 0 or more, found {}", mse));
  if (mse == 0) return std::numeric_limits<double>::infinity();
  return -10.0 * std::log10(mse);
}

double psnr(const RgbPicture& rendering, const RgbPicture& truth, std::span<const std::uint8_t> mask) {
  return psnr(mean_squared_error(rendering, truth, mask));
}

std::array<double, 3> ssim_channels(const RgbPicture& rendering, const RgbPicture& truth, const CropRectangle& crop,
                                    double data_range) {
  check_pair(rendering, truth);
  if (crop.x0 < 0 || crop.y0 < 0 || crop.x1 > truth.width || crop.y1 > truth.height) {
    throw std::invalid_argument(fmt::format("SSIM: expected a crop inside the {}x{} picture, found x {}..{}, y {}..{}",
                                            truth.width, truth.height, crop.x0, crop.x1, crop.y0, crop.y1));
  }
  const int width = crop.x1 - crop.x0;
  const int height = crop.y1 - crop.y0;
  if (width < kSsimWindow || height < kSsimWindow) {
    throw std::invalid_argument(
        fmt::format("SSIM: expected a crop of at least {0}x{0} pixels, found {1}x{2}", kSsimWindow, width, height));
  }
  if (!(data_range > 0) || !std::isfinite(data_range)) {
    throw std::invalid_argument(fmt::format("SSIM: expected a data range above 0, found {}", data_range));
  }

  const double c1 = 0.01 * 0.01 * data_range * data_range;
  const double c2 = 0.03 * 0.03 * data_range * data_range;
  const double count = kSsimWindow * kSsimWindow;
  const double sample = count / (count - 1);

  std::array<double, 3> result{};
  // Sums over columns of seven first, then over seven of those: 14 additions a pixel instead of 49, and, unlike running
  // sums, each window's result depends on its own pixels only.
  std::vector<Moments> columns(static_cast<std::size_t>(width));
  for (int channel = 0; channel < 3; ++channel) {
    double sum = 0;
    for (int top = 0; top + kSsimWindow <= height; ++top) {
      std::fill(columns.begin(), columns.end(), Moments{});
      for (int y = crop.y0 + top; y < crop.y0 + top + kSsimWindow; ++y) {
        std::size_t index = 3 * (static_cast<std::size_t>(y) * truth.width + crop.x0) + channel;
        for (Moments& column : columns) {
          const double a = rendering.rgb[index];
          const double b = truth.rgb[index];
          column.add({a, b, a * a, b * b, a * b});
          index += 3;
        }
      }
      for (int left = 0; left + kSsimWindow <= width; ++left) {
        Moments m;
        for (int x = left; x < left + kSsimWindow; ++x) m.add(columns[static_cast<std::size_t>(x)]);
        const double ux = m.x / count;
        const double uy = m.y / count;
        const double vx = sample * (m.xx / count - ux * ux);
        const double vy = sample * (m.yy / count - uy * uy);
        const double vxy = sample * (m.xy / count - ux * uy);
        sum += (2 * ux * uy + c1) * (2 * vxy + c2) / ((ux * ux + uy * uy + c1) * (vx + vy + c2));
      }
    }
    const double windows = static_cast<double>(width - kSsimWindow + 1) * static_cast<double>(height - kSsimWindow + 1);
    result[static_cast<std::size_t>(channel)] = require_finite(sum) / windows;
  }
  return result;
}

double ssim(const RgbPicture& rendering, const RgbPicture& truth, const CropRectangle& crop, double data_range) {
  const std::array<double, 3> channels = ssim_channels(rendering, truth, crop, data_range);
  return (channels[0] + channels[1] + channels[2]) / 3.0;
}

ImageMetrics image_metrics(const RgbPicture& rendering, const RgbPicture& truth, std::span<const std::uint8_t> mask) {
  ImageMetrics metrics;
  metrics.mse = mean_squared_error(rendering, truth, mask);
  metrics.psnr = psnr(metrics.mse);
  metrics.crop = mask_bounds(mask, truth.width, truth.height);
  if (metrics.crop.x1 - metrics.crop.x0 >= kSsimWindow && metrics.crop.y1 - metrics.crop.y0 >= kSsimWindow) {
    metrics.ssim = ssim(rendering, truth, metrics.crop);
    metrics.ssim_of_the_paper = ssim(rendering, truth, metrics.crop, kDataRangeOfThePaper);
  }
  return metrics;
}

std::optional<double> mean_of_finite(std::span<const double> values) {
  double sum = 0;
  std::size_t count = 0;
  for (double value : values) {
    if (!std::isfinite(value)) continue;
    sum += value;
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sum / static_cast<double>(count);
}

std::optional<double> spread_of_finite(std::span<const double> values) {
  const std::optional<double> mean = mean_of_finite(values);
  double squares = 0;
  std::size_t count = 0;
  for (double value : values) {
    if (!std::isfinite(value)) continue;
    squares += (value - *mean) * (value - *mean);
    ++count;
  }
  if (count < 2) return std::nullopt;
  return std::sqrt(squares / static_cast<double>(count - 1));
}

}  // namespace arah
