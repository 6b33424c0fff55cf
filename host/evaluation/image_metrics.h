// How near a rendered picture is to the photograph: PSNR and SSIM (ARAH.md, "Metrics").
//
// All pictures here are float RGB, interleaved, row-major, `width * height * 3` numbers, values in [0, 1] by convention
// (values outside are taken as they are: nothing is clamped or quantised to 8 bits). Masks are `width * height` bytes,
// nonzero = inside. Arithmetic is double. Every function throws std::invalid_argument for sizes that do not fit and for
// pictures that hold a NaN or an infinity where they are read: a metric is never silently NaN.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

namespace arah {

struct RgbPicture {
  std::span<const float> rgb;  // [height][width][3]
  int width = 0;               // >= 1
  int height = 0;              // >= 1
};

// Pixels x0 <= x < x1, y0 <= y < y1.
struct CropRectangle {
  int x0 = 0;
  int y0 = 0;
  int x1 = 0;
  int y1 = 0;
  bool operator==(const CropRectangle&) const = default;
};

// The two data ranges in use: 1 is the range of the values; 2 is what skimage assumes for float pictures and what the
// paper's tables were made with. A larger range softens SSIM's constants and so gives a higher figure.
inline constexpr double kDataRange = 1.0;
inline constexpr double kDataRangeOfThePaper = 2.0;

// Side of SSIM's window in pixels; the least width and height that it can be computed on.
inline constexpr int kSsimWindow = 7;

// The smallest rectangle that holds every pixel of the mask. Throws std::invalid_argument where the mask is empty.
CropRectangle mask_bounds(std::span<const std::uint8_t> mask, int width, int height);

// Mean over the pixels of the mask and their three channels of (rendering - truth)^2.
// Throws std::invalid_argument where the mask is empty.
double mean_squared_error(const RgbPicture& rendering, const RgbPicture& truth, std::span<const std::uint8_t> mask);

// -10 log10(mse) in decibels, for a peak value of 1. +infinity for mse = 0, identical pictures: JSON writers write it
// as null, the report as the sign of infinity, and means leave it out (mean_of_finite).
double psnr(double mse);
double psnr(const RgbPicture& rendering, const RgbPicture& truth, std::span<const std::uint8_t> mask);

// SSIM of one channel each, as scikit-image 0.19's structural_similarity: 7x7 uniform window, sample covariance
// (49/48), K1 = 0.01, K2 = 0.03, C = (K * data_range)^2, mean over the windows that lie wholly inside `crop` (the 3 px
// border is cut). In [-1, 1]; 1 where the pictures are identical. Throws std::invalid_argument where the crop
// leaves the picture, is narrower or lower than 7 px, or data_range <= 0.
std::array<double, 3> ssim_channels(const RgbPicture& rendering, const RgbPicture& truth, const CropRectangle& crop,
                                    double data_range = kDataRange);
// Mean of the three channels.
double ssim(const RgbPicture& rendering, const RgbPicture& truth, const CropRectangle& crop,
            double data_range = kDataRange);

struct ImageMetrics {
  double mse = 0;              // over the mask
  double psnr = 0;             // over the mask, dB; +infinity for identical pictures
  std::optional<double> ssim;  // over `crop`; absent where the crop is narrower or lower than 7 px
  std::optional<double> ssim_of_the_paper;  // the same with the paper's data range
  CropRectangle crop;          // bounding rectangle of the mask
};

ImageMetrics image_metrics(const RgbPicture& rendering, const RgbPicture& truth, std::span<const std::uint8_t> mask);

// Mean over the finite values; absent where there is none.
std::optional<double> mean_of_finite(std::span<const double> values);
// Their standard deviation, √(Σ (x − mean)² / (n − 1)); absent for fewer than two.
std::optional<double> spread_of_finite(std::span<const double> values);

}  // namespace arah
