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
    if (needs_renderer(layer)) {
      EXPECT_THROW(image(layer), std::invalid_argument) << to_string(layer);
      continue;
    }
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
    if (needs_inspection(layer) || needs_normals(layer) || needs_renderer(layer)) {
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

TEST_F(Layers, OfDistancesHaveLinesEveryCentimetre) {
  const DistanceSlice slice{13, 1, {0.0f, 0.013f, 0.015f, 0.019f, 0.021f, 0.022f, 0.09f, 0.001f, -0.001f, 0.118f, 0.131f, -0.2f, 0.0f}, {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0}};
  const LayerImage made = slice_layer(slice);
  const auto color = [&](std::size_t i) { return Rgb{made.rgba[4 * i], made.rgba[4 * i + 1], made.rgba[4 * i + 2]}; };
  EXPECT_EQ(made.legend.low, -0.1);
  EXPECT_EQ(made.legend.high, 0.1);
  EXPECT_EQ(made.legend.colors[made.legend.colors.size() / 2], (Rgb{255, 255, 255}));
  EXPECT_GT(color(1)[0], color(1)[2]) << "outside is red";
  EXPECT_GT(color(1)[2], color(3)[2]) << "and darker on a line";
  EXPECT_NEAR(color(3)[2], 0.82 * color(4)[2], 8) << "which is the last pixel before the centimetre";
  EXPECT_NEAR(color(5)[2], color(4)[2], 3) << "none where the distance jumps";
  EXPECT_EQ(color(7), (Rgb{0, 0, 0})) << "the surface";
  EXPECT_EQ(color(9), made.legend.colors.back()) << "no lines beyond the scale";
  EXPECT_EQ(color(11), made.legend.colors.front());
  EXPECT_EQ(color(12)[0], color(12)[2]) << "grey without a canonical point";
  for (std::size_t i = 0; i < 13; ++i) EXPECT_EQ(made.rgba[4 * i + 3], 255);
}

class WeightLayers : public DeviceTest {};

TEST_F(WeightLayers, ShowPartsOfOne) {
  for (const Skinning kind : {Skinning::network, Skinning::backward, Skinning::template_weights}) {
    AvatarSpec spec = small_paper_spec();
    spec.skinning.kind = kind;
    if (!spec.skinning.learned()) spec.skinning = {kind, 0, 0};
    const Avatar avatar = capsule_avatar(device, spec);
    const Pose pose = bent_pose(avatar.body.skeleton);
    const Camera camera = capsule_camera(45, 53);
    RenderSettings settings = render_preset(avatar, "paper");
    settings.inspect = true;
    Renderer renderer(device, avatar, settings);
    const Picture picture = renderer.render(camera, pose, 0);
    std::vector<LayerImage> of_joints;
    for (int joint = 0; joint < 3; ++joint) of_joints.push_back(weights_layer(renderer, avatar, picture, camera, pose, joint));
    const LayerImage all = weights_layer(renderer, avatar, picture, camera, pose, -1);
    EXPECT_THROW(weights_layer(renderer, avatar, picture, camera, pose, 3), std::invalid_argument);
    EXPECT_EQ(of_joints[1].legend.text, "skinning weight of bone_1");
    std::array<size_t, 3> most{};
    size_t seen = 0;
    for (std::size_t i = 0; i < picture.depth.size(); ++i) {
      EXPECT_EQ(all.rgba[4 * i + 3] > 0, of_joints[0].rgba[4 * i + 3] > 0);
      if (picture.depth[i] <= 0) continue;
      seen += 1;
      double sum = 0;
      std::array<double, 3> mixed{};
      for (std::size_t joint = 0; joint < 3; ++joint) {
        const std::vector<Rgb>& scale = of_joints[joint].legend.colors;
        const Rgb color{of_joints[joint].rgba[4 * i], of_joints[joint].rgba[4 * i + 1], of_joints[joint].rgba[4 * i + 2]};
        const auto found = std::find(scale.begin(), scale.end(), color);
        ASSERT_NE(found, scale.end());
        const double weight = double(found - scale.begin()) / double(scale.size() - 1);
        sum += weight;
        most[joint] += weight > 0.5;
        for (std::size_t c = 0; c < 3; ++c) mixed[c] += weight * joint_color(joint)[c];
      }
      EXPECT_NEAR(sum, 1, 0.01);
      for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(all.rgba[4 * i + c], mixed[c], 2);
    }
    std::printf("  skinning %-16s %zu pixels, most of bones' weight in %zu, %zu and %zu\n", to_string(kind), seen, most[0], most[1], most[2]);
    EXPECT_GT(seen, 200u);
    for (const size_t pixels : most) EXPECT_GT(pixels, 5u);
  }
}

TEST(JointColors, AreToldApart) {
  for (std::size_t a = 0; a < 24; ++a)
    for (std::size_t b = 0; b < a; ++b) {
      int apart = 0;
      for (std::size_t c = 0; c < 3; ++c) apart += std::abs(int{joint_color(a)[c]} - int{joint_color(b)[c]});
      EXPECT_GT(apart, 20) << a << ", " << b;
    }
}

}  // namespace
}  // namespace arah
