// PSNR and SSIM: against the golden figures, against values known by hand, and by what must not change them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <vector>

#include "host/evaluation/image_metrics.h"
#include "tests/golden.h"

namespace arah {
namespace {

// A picture with structure in every window, different in each channel.
std::vector<float> waves(int width, int height, double phase) {
  std::vector<float> rgb;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) {
        rgb.push_back(static_cast<float>(0.5 + 0.3 * std::sin(0.7 * x + 0.4 * y * (c + 1) + phase)));
      }
    }
  }
  return rgb;
}

std::vector<std::uint8_t> whole(int width, int height) {
  return std::vector<std::uint8_t>(static_cast<std::size_t>(width * height), 1);
}

TEST(ImageMetrics, MatchTheGoldenFigures) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("13_metrics_images");
  const int height = static_cast<int>(truth.extent("in.gt", 0));
  const int width = static_cast<int>(truth.extent("in.gt", 1));
  const std::vector<float> photograph = truth.tensor("in.gt").as<float>();
  const std::vector<float> rendered = truth.tensor("in.pred").as<float>();
  const std::vector<std::uint8_t> mask = truth.tensor("in.mask").as<std::uint8_t>();
  const RgbPicture pred{rendered, width, height};
  const RgbPicture gt{photograph, width, height};

  const std::vector<int> box = truth.integers("out.crop");  // y0, y1, x0, x1
  const CropRectangle crop = mask_bounds(mask, width, height);
  EXPECT_EQ(crop, (CropRectangle{box[2], box[0], box[3], box[1]}));
  const CropRectangle full{0, 0, width, height};

  golden::expect_golden(truth, "out.mse_mask", mean_squared_error(pred, gt, mask));
  golden::expect_golden(truth, "out.psnr_mask", psnr(pred, gt, mask));
  golden::expect_golden(truth, "out.psnr_full", psnr(pred, gt, whole(width, height)));
  golden::expect_golden(truth, "out.ssim_crop_range1", ssim(pred, gt, crop));
  golden::expect_golden(truth, "out.ssim_crop_range2", ssim(pred, gt, crop, kDataRangeOfThePaper));
  golden::expect_golden(truth, "out.ssim_crop_range2_channels", ssim_channels(pred, gt, crop, kDataRangeOfThePaper));
  golden::expect_golden(truth, "out.ssim_full_range1", ssim(pred, gt, full));
  golden::expect_golden(truth, "out.ssim_full_range2", ssim(pred, gt, full, kDataRangeOfThePaper));

  const ImageMetrics together = image_metrics(pred, gt, mask);
  EXPECT_EQ(together.crop, crop);
  golden::expect_golden(truth, "out.psnr_mask", together.psnr);
  ASSERT_TRUE(together.ssim && together.ssim_of_the_paper);
  golden::expect_golden(truth, "out.ssim_crop_range1", *together.ssim);
  golden::expect_golden(truth, "out.ssim_crop_range2", *together.ssim_of_the_paper);
}

TEST(ImageMetrics, SpreadIsThatOfASample) {
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_DOUBLE_EQ(spread_of_finite(std::vector<double>{2, infinity, 4, 4, 4, 5, 5, 7, 9}).value(), std::sqrt(32.0 / 7));
  EXPECT_FALSE(spread_of_finite(std::vector<double>{3, infinity}));
  EXPECT_FALSE(spread_of_finite(std::vector<double>{}));
}

TEST(ImageMetrics, AConstantErrorOfATenthIsTwentyDecibels) {
  const int width = 13, height = 9;
  const std::vector<float> truth(13 * 9 * 3, 0.25f);
  const std::vector<float> rendering(13 * 9 * 3, 0.35f);
  EXPECT_NEAR(psnr({rendering, width, height}, {truth, width, height}, whole(width, height)), 20.0, 1e-5);
}

TEST(ImageMetrics, SsimOfTwoConstantsIsTheLuminanceTermAlone) {
  const int width = 8, height = 11;
  const std::vector<float> truth(8 * 11 * 3, 0.25f);
  const std::vector<float> rendering(8 * 11 * 3, 0.75f);
  for (const double range : {1.0, 2.0}) {
    const double c1 = 1e-4 * range * range;
    const double expected = (2 * 0.25 * 0.75 + c1) / (0.25 * 0.25 + 0.75 * 0.75 + c1);
    EXPECT_NEAR(ssim({rendering, width, height}, {truth, width, height}, {0, 0, width, height}, range), expected,
                1e-12);
  }
}

TEST(ImageMetrics, IdenticalPicturesHaveInfinitePsnrAndAnSsimOfOne) {
  const int width = 19, height = 12;
  const std::vector<float> picture = waves(width, height, 0);
  const ImageMetrics metrics = image_metrics({picture, width, height}, {picture, width, height}, whole(width, height));
  EXPECT_EQ(metrics.mse, 0);
  EXPECT_EQ(metrics.psnr, std::numeric_limits<double>::infinity());
  ASSERT_TRUE(metrics.ssim.has_value());
  EXPECT_NEAR(*metrics.ssim, 1.0, 1e-14);
}

TEST(ImageMetrics, MovingBothPicturesAndTheMaskChangesNothing) {
  const int width = 17, height = 12, dx = 5, dy = 3;
  const int wide = width + 9, high = height + 7;
  const std::vector<float> truth = waves(width, height, 0), rendering = waves(width, height, 0.4);
  std::vector<float> moved_truth(static_cast<std::size_t>(wide * high * 3), 0.9f);
  std::vector<float> moved_rendering(static_cast<std::size_t>(wide * high * 3), 0.1f);
  std::vector<std::uint8_t> moved_mask(static_cast<std::size_t>(wide * high), 0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::size_t from = static_cast<std::size_t>(y * width + x);
      const std::size_t to = static_cast<std::size_t>((y + dy) * wide + x + dx);
      moved_mask[to] = 255;
      for (std::size_t c = 0; c < 3; ++c) {
        moved_truth[3 * to + c] = truth[3 * from + c];
        moved_rendering[3 * to + c] = rendering[3 * from + c];
      }
    }
  }
  const ImageMetrics plain = image_metrics({rendering, width, height}, {truth, width, height}, whole(width, height));
  const ImageMetrics moved = image_metrics({moved_rendering, wide, high}, {moved_truth, wide, high}, moved_mask);
  EXPECT_EQ(moved.crop, (CropRectangle{dx, dy, dx + width, dy + height}));
  EXPECT_EQ(moved.mse, plain.mse);
  EXPECT_EQ(moved.ssim, plain.ssim);
  EXPECT_LT(*plain.ssim, 0.99);
}

TEST(ImageMetrics, AreSymmetricAndOrderedByTheSizeOfTheError) {
  const int width = 16, height = 15;
  const std::vector<float> truth = waves(width, height, 0), near = waves(width, height, 0.1),
                           far = waves(width, height, 1);
  const RgbPicture t{truth, width, height}, n{near, width, height}, f{far, width, height};
  const CropRectangle all{0, 0, width, height};
  EXPECT_NEAR(ssim(t, n, all), ssim(n, t, all), 1e-14);
  EXPECT_EQ(psnr(t, n, whole(width, height)), psnr(n, t, whole(width, height)));
  EXPECT_GT(ssim(t, n, all), ssim(t, f, all));
  EXPECT_GT(psnr(t, n, whole(width, height)), psnr(t, f, whole(width, height)));
}

TEST(ImageMetrics, PixelsOutsideTheMaskDoNotCountForPsnr) {
  const int width = 9, height = 8;
  const std::vector<float> truth = waves(width, height, 0);
  std::vector<float> rendering = waves(width, height, 0.2);
  std::vector<std::uint8_t> mask = whole(width, height);
  mask[10] = 0;
  const double before = psnr({rendering, width, height}, {truth, width, height}, mask);
  rendering[31] = std::numeric_limits<float>::quiet_NaN();  // a channel of pixel 10
  EXPECT_EQ(psnr({rendering, width, height}, {truth, width, height}, mask), before);
}

TEST(ImageMetrics, SevenPixelsAreTheLeastForSsim) {
  const int width = 7, height = 7;
  const std::vector<float> truth = waves(width, height, 0), rendering = waves(width, height, 0.3);
  const RgbPicture r{rendering, width, height}, t{truth, width, height};
  const double value = ssim(r, t, {0, 0, 7, 7});
  EXPECT_GT(value, -1);
  EXPECT_LT(value, 1);
  EXPECT_THROW(ssim(r, t, {0, 0, 6, 7}), std::invalid_argument);
  EXPECT_THROW(ssim(r, t, {0, 1, 7, 7}), std::invalid_argument);

  std::vector<std::uint8_t> mask(49, 0);
  mask[24] = 1;
  const ImageMetrics one_pixel = image_metrics(r, t, mask);
  EXPECT_EQ(one_pixel.crop, (CropRectangle{3, 3, 4, 4}));
  EXPECT_FALSE(one_pixel.ssim.has_value());
  EXPECT_TRUE(std::isfinite(one_pixel.psnr));
}

TEST(ImageMetrics, RefuseWhatHasNoMeaning) {
  const int width = 8, height = 9;
  const std::vector<float> truth = waves(width, height, 0);
  const RgbPicture t{truth, width, height};
  const std::vector<std::uint8_t> nothing(72, 0);
  EXPECT_THROW(mask_bounds(nothing, width, height), std::invalid_argument);
  EXPECT_THROW(psnr(t, t, nothing), std::invalid_argument);
  EXPECT_THROW(psnr(t, t, std::span(nothing).first(71)), std::invalid_argument);
  EXPECT_THROW(psnr(t, {truth, height, width}, whole(width, height)), std::invalid_argument);
  EXPECT_THROW(psnr({std::span(truth).first(9), width, height}, t, whole(width, height)), std::invalid_argument);
  EXPECT_THROW(psnr({{}, 0, 0}, {{}, 0, 0}, {}), std::invalid_argument);
  EXPECT_THROW(ssim(t, t, {-1, 0, 8, 9}), std::invalid_argument);
  EXPECT_THROW(ssim(t, t, {0, 0, 9, 9}), std::invalid_argument);
  EXPECT_THROW(ssim(t, t, {0, 0, 8, 9}, 0.0), std::invalid_argument);
  EXPECT_THROW(psnr(-1e-9), std::invalid_argument);
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    std::vector<float> broken = truth;
    broken[100] = bad;
    EXPECT_THROW(psnr({broken, width, height}, t, whole(width, height)), std::invalid_argument);
    EXPECT_THROW(ssim({broken, width, height}, t, {0, 0, width, height}), std::invalid_argument);
  }
}

TEST(ImageMetrics, TheMeanLeavesOutWhatIsNotFinite) {
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(mean_of_finite(std::vector<double>{20, infinity, 30, std::nan("")}), 25);
  EXPECT_EQ(mean_of_finite(std::vector<double>{infinity}), std::nullopt);
  EXPECT_EQ(mean_of_finite({}), std::nullopt);
}

}  // namespace
}  // namespace arah
