#include "viewer/comparison.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "host/evaluation/picture.h"

namespace arah {
namespace {

using Pixel = std::array<int, 4>;

// Four pixels in a row: opaque red, half transparent green, nothing, opaque blue.
Picture rendering() {
  Picture picture;
  picture.width = 4;
  picture.height = 1;
  picture.color = {1, 0, 0, 0, 0.5f, 0, 0, 0, 0, 0, 0, 1};
  picture.alpha = {1, 0.5f, 0, 1};
  return picture;
}

// Opaque grey; the last pixel is outside the mask.
Image photograph() { return {4, 1, {0.4f, 0.4f, 0.4f, 1, 0.4f, 0.4f, 0.4f, 1, 0.4f, 0.4f, 0.4f, 1, 0, 0, 0, 0}}; }

Pixel pixel(const Rgba8& picture, std::size_t i) { return {picture.bytes[4 * i], picture.bytes[4 * i + 1], picture.bytes[4 * i + 2], picture.bytes[4 * i + 3]}; }

Rgba8 shown(const Comparison& comparison, double time = 0) {
  const Image photo = photograph();
  return compared(rendering(), &photo, comparison, time);
}

TEST(ComparisonTest, OffShowsTheRenderingWithStraightAlpha) {
  const Rgba8 off = shown({});
  EXPECT_EQ(off.width, 4);
  EXPECT_EQ(off.height, 1);
  EXPECT_EQ(off.bytes.size(), 16u);
  EXPECT_EQ(pixel(off, 0), (Pixel{255, 0, 0, 255}));
  EXPECT_EQ(pixel(off, 1), (Pixel{0, 255, 0, 128}));
  EXPECT_EQ(pixel(off, 2), (Pixel{0, 0, 0, 0}));
  for (const ComparisonMode mode : {ComparisonMode::behind, ComparisonMode::blink, ComparisonMode::split, ComparisonMode::error_map})
    EXPECT_EQ(compared(rendering(), nullptr, {mode, 0, 1, 4}, 0.7).bytes, off.bytes) << to_string(mode);
}

TEST(ComparisonTest, ThePhotographLiesBehind) {
  const Rgba8 behind = shown({ComparisonMode::behind});
  EXPECT_EQ(pixel(behind, 0), (Pixel{255, 0, 0, 255}));
  EXPECT_EQ(pixel(behind, 1), (Pixel{51, 179, 51, 255}));  // half of 0.4, and half of it plus the green
  EXPECT_EQ(pixel(behind, 2), (Pixel{102, 102, 102, 255}));
  EXPECT_EQ(pixel(behind, 3), (Pixel{0, 0, 255, 255}));
}

TEST(ComparisonTest, BlinksByTheTime) {
  const Comparison blink{ComparisonMode::blink, 0.5, 2};
  EXPECT_EQ(pixel(shown(blink, 0.1), 0), (Pixel{255, 0, 0, 255}));
  EXPECT_EQ(pixel(shown(blink, 1.1), 0), (Pixel{102, 102, 102, 255}));
  EXPECT_EQ(pixel(shown(blink, 2.1), 0), (Pixel{255, 0, 0, 255}));
  EXPECT_EQ(pixel(shown(blink, 1.1), 3), (Pixel{0, 0, 0, 0}));
  EXPECT_TRUE(blink_shows_photograph({ComparisonMode::blink, 0.5, 0}, 0.06));  // a period of at least 0.1 s
  EXPECT_FALSE(blink_shows_photograph({ComparisonMode::blink, 0.5, 0}, 0.11));
  EXPECT_FALSE(blink_shows_photograph(blink, std::nan("")));
  EXPECT_TRUE(blink_shows_photograph(blink, -0.1));
}

TEST(ComparisonTest, SplitsAtThePosition) {
  for (const auto& [position, columns] : {std::pair(0.0, 0u), std::pair(0.3, 1u), std::pair(0.5, 2u), std::pair(1.0, 4u), std::pair(7.0, 4u), std::pair(-1.0, 0u)}) {
    const Rgba8 split = shown({ComparisonMode::split, position}), photo = shown({ComparisonMode::split, 1.0}), off = shown({});
    for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(pixel(split, i), i < columns ? pixel(photo, i) : pixel(off, i)) << position << " " << i;
  }
}

TEST(ComparisonTest, MapsErrors) {
  Picture same = rendering();
  const Image photo = photograph();
  same.color = {0.4f, 0.4f, 0.4f, 0.65f, 0.4f, 0.4f, 0.4f, 0.4f, 0.4f, 0, 0, 1};
  const Rgba8 map = compared(same, &photo, {ComparisonMode::error_map, 0.5, 1, 2}, 0);
  EXPECT_EQ(pixel(map, 0), (Pixel{0, 0, 0, 255}));
  EXPECT_EQ(pixel(map, 2), (Pixel{0, 0, 0, 255}));
  const std::vector<float> expected = error_map(std::vector<float>{0.65f, 0.4f, 0.4f, 0, 0, 1}, std::vector<float>{0.4f, 0.4f, 0.4f, 0, 0, 0}, 2, 1, 2);
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_EQ(pixel(map, 1)[c], std::lround(255 * expected[c]));
    EXPECT_EQ(pixel(map, 3)[c], std::lround(255 * expected[3 + c]));
  }
  // A third of 1 is beyond a half of a half: twice the gain is brighter.
  const Rgba8 brighter = compared(same, &photo, {ComparisonMode::error_map, 0.5, 1, 4}, 0);
  EXPECT_GT(pixel(brighter, 3)[1], pixel(map, 3)[1]);
}

TEST(ComparisonTest, WhatIsNotFiniteIsSeen) {
  Picture broken = rendering();
  broken.color[0] = std::nanf("");
  const Image photo = photograph();
  for (const ComparisonMode mode : {ComparisonMode::off, ComparisonMode::behind, ComparisonMode::error_map}) EXPECT_EQ(pixel(compared(broken, &photo, {mode}, 0), 0), (Pixel{255, 0, 255, 255})) << to_string(mode);
  EXPECT_EQ(pixel(compared(broken, &photo, {ComparisonMode::split, 1}, 0), 0), (Pixel{102, 102, 102, 255}));  // not shown there
}

TEST(ComparisonTest, MeasuresWhatIsInTheMask) {
  const PixelMask all{4, 1, {1, 1, 1, 1}}, third{4, 1, {0, 0, 1, 0}}, none{4, 1, {0, 0, 0, 0}};
  // Squares: 0.36 + 2 * 0.16, 0.16 * 2 + 0.01, 3 * 0.16, 1.
  EXPECT_NEAR(*compared_psnr(rendering(), photograph(), all), -10 * std::log10((0.68 + 0.33 + 0.48 + 1) / 12), 1e-6);
  EXPECT_NEAR(*compared_psnr(rendering(), photograph(), third), -10 * std::log10(0.16), 1e-6);
  EXPECT_EQ(compared_psnr(rendering(), photograph(), none), std::nullopt);
  Picture broken = rendering();
  broken.color[0] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(compared_psnr(broken, photograph(), all), std::nullopt);
  EXPECT_TRUE(compared_psnr(broken, photograph(), third));
  Picture same = rendering();
  same.color = {0.4f, 0.4f, 0.4f, 0.4f, 0.4f, 0.4f, 0.4f, 0.4f, 0.4f, 0, 0, 0};
  EXPECT_TRUE(std::isinf(*compared_psnr(same, photograph(), all)));
}

TEST(ComparisonTest, RefusesSizesThatDiffer) {
  const Image photo = photograph(), small{2, 1, std::vector<float>(8)};
  EXPECT_THROW(compared(rendering(), &small, {ComparisonMode::split}, 0), std::invalid_argument);
  EXPECT_THROW(compared_psnr(rendering(), small, {4, 1, {1, 1, 1, 1}}), std::invalid_argument);
  EXPECT_THROW(compared_psnr(rendering(), photo, {2, 1, {1, 1}}), std::invalid_argument);
  Picture torn = rendering();
  torn.alpha.pop_back();
  EXPECT_THROW(compared(torn, &photo, {}, 0), std::invalid_argument);
  EXPECT_THROW(compared({}, &photo, {}, 0), std::invalid_argument);
}

}  // namespace
}  // namespace arah
