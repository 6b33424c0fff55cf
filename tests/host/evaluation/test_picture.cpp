// Pictures as PNG: what is written is what OpenCV reads back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <vector>

#include "host/evaluation/bad_pixels.h"
#include "host/evaluation/picture.h"

namespace arah {
namespace {

using testing::ElementsAre;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

TEST(Picture, RgbSurvivesTheRoundTrip) {
  const int width = 5, height = 3;
  std::vector<float> values;
  for (int i = 0; i < width * height * 3; ++i) values.push_back(static_cast<float>(i * 5) / 255.0f);
  const cv::Mat read = cv::imdecode(encode_png(values, width, height, 3), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(read.type(), CV_8UC3);
  ASSERT_EQ(read.size(), cv::Size(width, height));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) EXPECT_EQ(read.at<cv::Vec3b>(y, x)[2 - c], 5 * (3 * (y * width + x) + c));
    }
  }
}

TEST(Picture, AlphaAndGreySurviveTheRoundTrip) {
  const std::vector<float> rgba = {1, 0, 0, 0.2f, 0, 0.6f, 1, 1};
  const cv::Mat colour = cv::imdecode(encode_png(rgba, 2, 1, 4), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(colour.type(), CV_8UC4);
  EXPECT_EQ(colour.at<cv::Vec4b>(0, 0), cv::Vec4b(0, 0, 255, 51));
  EXPECT_EQ(colour.at<cv::Vec4b>(0, 1), cv::Vec4b(255, 153, 0, 255));
  const std::vector<float> grey = {0, 0.4f, 1};
  const cv::Mat read = cv::imdecode(encode_png(grey, 1, 3, 1), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(read.type(), CV_8UC1);
  EXPECT_EQ(read.at<std::uint8_t>(1, 0), 102);
  EXPECT_EQ(read.at<std::uint8_t>(2, 0), 255);
}

TEST(Picture, ValuesAreClampedAndWhatIsNotFiniteIsSeen) {
  const std::vector<float> values = {-3, 7, 0.5f, 0, kNan, 0, kInfinity, 0, 0};
  const cv::Mat read = cv::imdecode(encode_png(values, 3, 1, 3), cv::IMREAD_UNCHANGED);
  EXPECT_EQ(read.at<cv::Vec3b>(0, 0), cv::Vec3b(128, 255, 0));
  EXPECT_EQ(read.at<cv::Vec3b>(0, 1), cv::Vec3b(255, 0, 255));
  EXPECT_EQ(read.at<cv::Vec3b>(0, 2), cv::Vec3b(255, 0, 255));
}

TEST(Picture, WhatIsNotFiniteIsCountedWhereverItIs) {
  Picture picture;
  picture.width = 4, picture.height = 3;
  picture.color.assign(36, 0.5f), picture.normal.assign(36, 0.0f), picture.alpha.assign(12, 1.0f), picture.depth.assign(12, 2.0f);
  EXPECT_EQ(bad_pixels(picture).count, 0u);
  EXPECT_EQ(bad_pixels(picture).pixels, 12u);
  picture.color[3 * 6 + 1] = kNan, picture.color[3 * 6 + 2] = kInfinity;  // one pixel: column 2, row 1
  picture.alpha[7] = kInfinity, picture.depth[9] = -kInfinity, picture.normal[3 * 11] = kNan;
  const BadPixels bad = bad_pixels(picture);
  EXPECT_EQ(bad.count, 4u);
  EXPECT_EQ(bad.column, 2);
  EXPECT_EQ(bad.row, 1);
  EXPECT_EQ(warning_of(bad, "out/color.png", "run"), "warning: out/color.png: 4 of 12 pixels are not finite, the first in column 2 of row 1 (magenta in colours); 'arah inspect run' names the tensor with the largest number");
  picture.normal.clear();
  EXPECT_EQ(bad_pixels(picture).count, 3u);

  EXPECT_FALSE(finite_colors(picture, {0, 0, 4, 3}));
  EXPECT_FALSE(finite_colors(picture, {2, 1, 3, 2}));
  EXPECT_TRUE(finite_colors(picture, {0, 0, 4, 1}));
  EXPECT_TRUE(finite_colors(picture, {3, 0, 4, 3})) << "alpha is not compared";
  EXPECT_TRUE(finite_colors(picture, {0, 0, 2, 3}));
}

TEST(Picture, ABadColourIsNotHiddenWhereThereIsNoAlpha) {
  const std::vector<float> color = {kNan, 0, 0, 0, kInfinity, 0, 0, 0, 0, 0.25f, 0, 0};
  const cv::Mat read = cv::imdecode(encode_png(straight_alpha(color, std::vector<float>{0, 0, 0, 0.5f}, 4, 1), 4, 1, 4), cv::IMREAD_UNCHANGED);
  const cv::Vec4b magenta(255, 0, 255, 255);
  EXPECT_EQ(read.at<cv::Vec4b>(0, 0), magenta);
  EXPECT_EQ(read.at<cv::Vec4b>(0, 1), magenta);
  EXPECT_EQ(read.at<cv::Vec4b>(0, 2), cv::Vec4b(0, 0, 0, 0));
  EXPECT_EQ(read.at<cv::Vec4b>(0, 3), cv::Vec4b(0, 0, 128, 128));
}

TEST(Picture, ErrorMapIsBlackWhereEqualAndBrightensWithTheDifference) {
  const std::vector<float> truth(4 * 3, 0.5f);
  std::vector<float> rendering = truth;
  for (std::size_t c = 0; c < 3; ++c) {
    rendering[3 + c] += 0.05f;
    rendering[6 + c] -= 0.3f;
  }
  rendering[9] = kNan;
  const std::vector<float> map = error_map(rendering, truth, 2, 2);
  auto brightness = [&](std::size_t pixel) { return map[3 * pixel] + map[3 * pixel + 1] + map[3 * pixel + 2]; };
  EXPECT_EQ(brightness(0), 0);
  EXPECT_GT(brightness(1), 0.2f);
  EXPECT_GT(brightness(2), brightness(1) + 0.5f);
  EXPECT_TRUE(std::isnan(brightness(3)));
  // Inferno ends in pale yellow (252, 255, 164).
  EXPECT_NEAR(map[6], 252 / 255.0, 0.02);
  EXPECT_NEAR(map[7], 1.0, 0.02);
  EXPECT_NEAR(map[8], 164 / 255.0, 0.02);
}

TEST(Picture, NormalsBecomeColoursAndNoNormalIsBlack) {
  const std::vector<float> normals = {1, 0, -1, 0, 0, 0, 0, -1, 0};
  EXPECT_THAT(normals_to_rgb(normals, 1, 3), ElementsAre(1, 0.5f, 0, 0, 0, 0, 0.5f, 0, 0.5f));
}

TEST(Picture, NearDepthsAreBrightAndTheBackgroundIsBlack) {
  const std::vector<float> depth = {2, 4, 3, 0, kInfinity, kNan, -1};
  const std::vector<float> grey = depth_to_grey(depth, 7, 1);
  EXPECT_FLOAT_EQ(grey[0], 1.0f);
  EXPECT_FLOAT_EQ(grey[1], 0.2f);
  EXPECT_FLOAT_EQ(grey[2], 0.6f);
  for (std::size_t i = 3; i < 7; ++i) EXPECT_EQ(grey[i], 0) << i;
  EXPECT_THAT(depth_to_grey(std::vector<float>{5, 0, 5}, 3, 1), ElementsAre(1, 0, 1));
  EXPECT_THAT(depth_to_grey(std::vector<float>{0, kNan}, 1, 2), ElementsAre(0, 0));
}

TEST(Picture, DepthIsStoredInMillimetres) {
  const std::vector<float> depth = {2.3456f, 0, 1e-5f, 100, kNan, -2};
  const cv::Mat read = cv::imdecode(encode_depth_png(depth, 3, 2), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(read.type(), CV_16UC1);
  ASSERT_EQ(read.size(), cv::Size(3, 2));
  const std::vector<int> expected = {2346, 0, 1, 65535, 0, 0};
  for (int i = 0; i < 6; ++i) EXPECT_EQ(read.at<std::uint16_t>(i / 3, i % 3), expected[static_cast<std::size_t>(i)]);
}

TEST(Picture, RefusesSizesThatDoNotFit) {
  const std::vector<float> twelve(12);
  EXPECT_THROW(encode_png(twelve, 2, 3, 3), std::invalid_argument);
  EXPECT_THROW(encode_png(twelve, 3, 2, 2), std::invalid_argument);
  EXPECT_THROW(encode_png({}, 0, 4, 3), std::invalid_argument);
  EXPECT_THROW(error_map(twelve, std::span(twelve).first(9), 2, 2), std::invalid_argument);
  EXPECT_THROW(normals_to_rgb(twelve, 3, 3), std::invalid_argument);
  EXPECT_THROW(depth_to_grey(twelve, 4, 2), std::invalid_argument);
  EXPECT_THROW(encode_depth_png(twelve, 4, 4), std::invalid_argument);
}

}  // namespace
}  // namespace arah
