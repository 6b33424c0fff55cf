#include "host/evaluation/picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace arah {
namespace {

void check_size(std::size_t found, int width, int height, int channels) {
  if (width < 1 || height < 1) {
    throw std::invalid_argument(fmt::format("picture: expected at least 1x1 pixels, found {}x{}", width, height));
  }
  const std::size_t expected =
      static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * static_cast<std::size_t>(channels);
  if (found != expected) {
    throw std::invalid_argument(fmt::format("picture of {}x{} with {} channels: expected {} values, found {}", width,
                                            height, channels, expected, found));
  }
}

bool is_surface(float depth) {
  return std::isfinite(depth) && depth > 0;
}

std::vector<std::uint8_t> encode(const cv::Mat& image) {
  std::vector<std::uint8_t> png;
  if (!cv::imencode(".png", image, png)) {
    throw std::runtime_error(fmt::format("PNG encoder: a picture of {}x{} was refused", image.cols, image.rows));
  }
  return png;
}

}  // namespace

std::vector<std::uint8_t> eight_bits(std::span<const float> values, int width, int height, int channels) {
  if (channels != 1 && channels != 3 && channels != 4) {
    throw std::invalid_argument(fmt::format("PNG: expected 1, 3 or 4 channels, found {}", channels));
  }
  check_size(values.size(), width, height, channels);
  constexpr std::array<std::uint8_t, 4> magenta = {255, 0, 255, 255};
  std::vector<std::uint8_t> bytes;
  bytes.reserve(values.size());
  for (std::size_t index = 0; index < values.size(); index += static_cast<std::size_t>(channels)) {
    const std::span<const float> pixel = values.subspan(index, static_cast<std::size_t>(channels));
    const bool finite = std::all_of(pixel.begin(), pixel.end(), [](float v) { return std::isfinite(v); });
    for (std::size_t c = 0; c < pixel.size(); ++c) {
      bytes.push_back(finite ? static_cast<std::uint8_t>(std::lround(255.0f * std::clamp(pixel[c], 0.0f, 1.0f))) : magenta[c]);
    }
  }
  return bytes;
}

std::vector<std::uint8_t> encode_png(std::span<const float> values, int width, int height, int channels) {
  std::vector<std::uint8_t> bytes = eight_bits(values, width, height, channels);
  cv::Mat image(height, width, CV_8UC(channels), bytes.data());
  if (channels == 3) cv::cvtColor(image, image, cv::COLOR_RGB2BGR);  // OpenCV stores blue first
  if (channels == 4) cv::cvtColor(image, image, cv::COLOR_RGBA2BGRA);
  return encode(image);
}

std::vector<float> straight_alpha(std::span<const float> color, std::span<const float> alpha, int width, int height) {
  check_size(color.size(), width, height, 3);
  check_size(alpha.size(), width, height, 1);
  std::vector<float> rgba;
  rgba.reserve(4 * alpha.size());
  for (std::size_t i = 0; i < alpha.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const float premultiplied = color[3 * i + c];  // what is not finite stays so without alpha too
      rgba.push_back(alpha[i] > 0 || !std::isfinite(premultiplied) ? premultiplied / alpha[i] : 0.0f);
    }
    rgba.push_back(alpha[i]);
  }
  return rgba;
}

std::vector<float> error_map(std::span<const float> rendering, std::span<const float> truth, int width, int height,
                             float gain) {
  check_size(rendering.size(), width, height, 3);
  check_size(truth.size(), width, height, 3);
  cv::Mat ramp(1, 256, CV_8UC1);
  for (int i = 0; i < 256; ++i) ramp.at<std::uint8_t>(0, i) = static_cast<std::uint8_t>(i);
  cv::Mat colours;
  cv::applyColorMap(ramp, colours, cv::COLORMAP_INFERNO);

  std::vector<float> map(truth.size());
  for (std::size_t i = 0; i < map.size(); i += 3) {
    const float difference = (std::fabs(rendering[i] - truth[i]) + std::fabs(rendering[i + 1] - truth[i + 1]) +
                              std::fabs(rendering[i + 2] - truth[i + 2])) /
                             3.0f;
    if (!std::isfinite(difference)) {
      std::fill_n(map.begin() + static_cast<std::ptrdiff_t>(i), 3, std::numeric_limits<float>::quiet_NaN());
      continue;
    }
    const long level = std::lround(255.0f * std::clamp(gain * difference, 0.0f, 1.0f));
    // Inferno's first entry is almost black; equal pixels are to be exactly black, as the background is.
    if (level == 0) continue;
    const cv::Vec3b colour = colours.at<cv::Vec3b>(0, static_cast<int>(level));
    for (int c = 0; c < 3; ++c) map[i + static_cast<std::size_t>(c)] = static_cast<float>(colour[2 - c]) / 255.0f;
  }
  return map;
}

std::vector<float> normals_to_rgb(std::span<const float> normals, int width, int height) {
  check_size(normals.size(), width, height, 3);
  std::vector<float> rgb(normals.size());
  for (std::size_t i = 0; i < rgb.size(); i += 3) {
    const float length = std::hypot(normals[i], normals[i + 1], normals[i + 2]);
    const float cover = length < 1 ? length : 1;  // a NaN stays in the normal itself
    for (std::size_t c = i; c < i + 3; ++c) rgb[c] = 0.5f * normals[c] + 0.5f * cover;
  }
  return rgb;
}

std::vector<float> depth_to_grey(std::span<const float> depth, int width, int height) {
  check_size(depth.size(), width, height, 1);
  float nearest = std::numeric_limits<float>::infinity();
  float farthest = 0;
  for (float d : depth) {
    if (!is_surface(d)) continue;
    nearest = std::min(nearest, d);
    farthest = std::max(farthest, d);
  }
  std::vector<float> grey(depth.size());
  for (std::size_t i = 0; i < grey.size(); ++i) {
    if (!is_surface(depth[i])) continue;
    grey[i] = farthest > nearest ? 1.0f - 0.8f * (depth[i] - nearest) / (farthest - nearest) : 1.0f;
  }
  return grey;
}

std::vector<std::uint8_t> encode_depth_png(std::span<const float> depth, int width, int height) {
  check_size(depth.size(), width, height, 1);
  cv::Mat image(height, width, CV_16UC1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float d =
          depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
      // A surface is never stored as 0, which says that there is none.
      image.at<std::uint16_t>(y, x) = is_surface(d)
                                          ? static_cast<std::uint16_t>(std::clamp(std::round(1000.0 * d), 1.0, 65535.0))
                                          : std::uint16_t{0};
    }
  }
  return encode(image);
}

}  // namespace arah
