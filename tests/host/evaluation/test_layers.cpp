// Layers of pictures: which colour stands for which number.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "host/body/canonical.h"
#include "host/evaluation/layers.h"
#include "host/input_error.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// One row of pixels that differ in one thing; the first one sees nothing.
class Layers : public testing::Test {
 protected:
  explicit Layers(std::size_t pixels = 5) {
    picture.width = static_cast<int>(pixels);
    picture.height = 1;
    picture.color.assign(3 * pixels, 0.5f);
    picture.alpha.assign(pixels, 1);
    picture.depth.assign(pixels, 2);
    picture.normal.assign(3 * pixels, 0);
    picture.inspection.emplace(pixels);
    picture.alpha[0] = picture.depth[0] = 0;
    for (std::size_t i = 1; i < pixels; ++i) {
      picture.inspection->placed[i] = 20;
      picture.inspection->wanted[i] = 10;
      picture.inspection->canonical[i] = {0, 0.8f, 0, 1};
      picture.normal[3 * i + 2] = 1;
    }
  }
  LayerImage image(PictureLayer layer) const { return layer_image(layer, picture, avatar()); }
  static std::array<int, 4> pixel(const LayerImage& image, std::size_t i) { return {image.rgba[4 * i], image.rgba[4 * i + 1], image.rgba[4 * i + 2], image.rgba[4 * i + 3]}; }
  static const Avatar& avatar() {
    static const Avatar made = make_avatar(small_paper_spec(), capsule_body(), {0}, 5);
    return made;
  }

  Picture picture;
};

TEST_F(Layers, HaveNamesAndAreTransparentWhereNothingIs) {
  for (const PictureLayer layer : all_layers()) {
    EXPECT_EQ(layer_named(to_string(layer)), layer);
    const LayerImage made = image(layer);
    ASSERT_EQ(made.rgba.size(), 4 * picture.alpha.size()) << to_string(layer);
    EXPECT_EQ(pixel(made, 0)[3], 0) << to_string(layer);
    EXPECT_EQ(pixel(made, 1)[3], 255) << to_string(layer);
    EXPECT_FALSE(describe(made.legend).empty());
    const cv::Mat read = cv::imdecode(encode_png(made), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(read.type(), CV_8UC4);
    const auto& bgra = read.at<cv::Vec4b>(0, 1);
    EXPECT_EQ((std::array<int, 4>{bgra[2], bgra[1], bgra[0], bgra[3]}), pixel(made, 1)) << to_string(layer);
  }
  EXPECT_THROW(layer_named("colour"), InputError);
  picture.inspection.reset();
  picture.normal.clear();
  for (const PictureLayer layer : all_layers()) {
    if (needs_inspection(layer) || needs_normals(layer)) {
      EXPECT_THROW(image(layer), std::invalid_argument) << to_string(layer);
    } else {
      EXPECT_NO_THROW(image(layer)) << to_string(layer);
    }
  }
}

TEST_F(Layers, CanonicalPlacesSpanTheTemplatesBox) {
  glm::dvec3 low(1e9), high(-1e9);
  for (const glm::dvec3& v : canonical_vertices(avatar().body, avatar().canonical)) low = glm::min(low, v), high = glm::max(high, v);
  const auto place = [&](std::size_t i, const glm::dvec3& p) { picture.inspection->canonical[i] = {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z), 1}; };
  place(1, low);
  place(2, high);
  place(3, {0.5 * (low.x + high.x), high.y + 1, low.z - 1});
  place(4, {0.01, 0.7995, 0.01});
  picture.inspection->canonical[4][3] = 0.25f;
  LayerImage made = image(PictureLayer::canonical);
  EXPECT_EQ(pixel(made, 1), (std::array<int, 4>{0, 0, 0, 255}));
  EXPECT_EQ(pixel(made, 2), (std::array<int, 4>{255, 255, 255, 255}));
  EXPECT_EQ(pixel(made, 3), (std::array<int, 4>{128, 255, 0, 255}));
  EXPECT_EQ(pixel(made, 4)[3], 64);
  EXPECT_THAT(made.legend.text, HasSubstr(fmt::format("{:.2f} to {:.2f} m", low.y, high.y)));

  // Two neighbours on either side of y = 80 cm.
  const int green = pixel(made, 4)[1];
  place(2, {0.01, 0.7995, 0.01});
  place(3, {0.01, 0.8005, 0.01});
  made = image(PictureLayer::canonical);
  EXPECT_NEAR(pixel(made, 2)[1], 0.55 * green, 1.5) << "a line";
  EXPECT_NEAR(pixel(made, 3)[1], green, 1) << "beside it none";
}

TEST_F(Layers, CountsAreOnTheirScales) {
  Inspection& told = *picture.inspection;
  told.shaded = {0, 0, 10, 20, 20};
  const LayerImage samples = image(PictureLayer::samples);
  EXPECT_EQ(samples.legend.high, 20);
  EXPECT_EQ(samples.legend.colors.size(), 256u);
  const auto color = [](const LayerImage& made, std::size_t i) { return Rgb{made.rgba[4 * i], made.rgba[4 * i + 1], made.rgba[4 * i + 2]}; };
  EXPECT_EQ(color(samples, 1), samples.legend.colors.front());
  EXPECT_EQ(color(samples, 2), samples.legend.colors[128]);
  EXPECT_EQ(color(samples, 3), samples.legend.colors.back());
  EXPECT_THAT(describe(samples.legend), HasSubstr("0 to 20 samples"));

  told.steps = {0, 0, 40, 80, 500};
  const LayerImage steps = image(PictureLayer::steps);
  EXPECT_EQ(color(steps, 1), steps.legend.colors.front());
  EXPECT_EQ(color(steps, 2), steps.legend.colors[128]) << "four in the mean of ten samples";
  EXPECT_EQ(color(steps, 3), steps.legend.colors.back());
  EXPECT_EQ(color(steps, 4), steps.legend.colors.back()) << "beyond the scale's end";

  told.unfound = {0, 0, 1, 5, 10};
  const LayerImage failures = image(PictureLayer::failures);
  EXPECT_EQ(color(failures, 1)[0], color(failures, 1)[2]) << "grey where all were found";
  EXPECT_EQ(color(failures, 1)[0], 107) << "0.12 + 0.6 of the colour's 0.5";
  EXPECT_EQ(color(failures, 2), failures.legend.colors[26]);
  EXPECT_EQ(color(failures, 4), failures.legend.colors.back());
}

TEST_F(Layers, NormalsAndDepthsHaveTheirs) {
  picture.normal = {0, 0, 0, 1, 0, 0, 0, -1, 0, 0, 0, 0.5f, 0, 0, 1};
  picture.alpha[3] = 0.5f;
  const LayerImage normals = image(PictureLayer::normal);
  EXPECT_EQ(pixel(normals, 1), (std::array<int, 4>{255, 128, 128, 255}));
  EXPECT_EQ(pixel(normals, 2), (std::array<int, 4>{128, 0, 128, 255}));
  EXPECT_EQ(pixel(normals, 3), (std::array<int, 4>{128, 128, 255, 128})) << "of unit length where half of the pixel is seen";
  picture.depth = {0, 1, 2, 3, 0};
  const LayerImage depths = image(PictureLayer::depth);
  EXPECT_EQ(pixel(depths, 1), (std::array<int, 4>{255, 255, 255, 255}));
  EXPECT_EQ(pixel(depths, 3), (std::array<int, 4>{51, 51, 51, 255}));
  EXPECT_EQ(pixel(depths, 4)[3], 0);
  EXPECT_EQ(depths.legend.low, 1);
  EXPECT_EQ(depths.legend.high, 3);
  EXPECT_EQ(depths.legend.colors.front(), (Rgb{255, 255, 255}));
}

}  // namespace
}  // namespace arah
