// Which pixels of a picture training draws rays from.
#include "host/training/training_images.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <set>

#include "host/rendering/avatar_networks.h"
#include "tests/host/training/training_scene.h"

namespace arah {
namespace {

using TrainingImagesTest = DeviceTest;

// Pixels that a border marks are not drawn; all others are as without one.
TEST_F(TrainingImagesTest, BordersAreLeftOut) {
  const Capture& plain = small_capture();
  const TrainingSettings settings = small_settings();
  Avatar avatar = make_avatar(small_spec(), plain, 3);
  AvatarNetworks networks(device, avatar, true);
  RaySamples finder(device, networks, 64, settings.sampling);
  const auto pixels = [&](const Capture& capture) {
    TrainingImages images(device, avatar, capture, 0, settings.sampling.shell);
    const TrainingImage& image = images.image(commands, finder, images.places().at(0));
    std::set<uint32_t> places;
    for (const auto& pixel : image.person) places.insert(pixel.place);
    for (const auto& pixel : image.around) places.insert(pixel.place);
    return places;
  };
  const std::set<uint32_t> all = pixels(plain);

  // Every third column is not to be trusted.
  Capture marked = plain;
  marked.path = plain.path.string() + "_marked";
  std::filesystem::copy(plain.path, marked.path, std::filesystem::copy_options::recursive);
  const Camera& camera = plain.cameras[0];
  cv::Mat border(camera.height, camera.width, CV_8U, cv::Scalar(0));
  for (int u = 0; u < border.cols; u += 3) border.col(u).setTo(255);
  const std::filesystem::path folder = marked.path / "borders" / "train" / camera.name;
  std::filesystem::create_directories(folder);
  ASSERT_TRUE(cv::imwrite((folder / "000000.png").string(), border));
  const std::set<uint32_t> rest = pixels(marked);
  std::filesystem::remove_all(marked.path);

  std::set<uint32_t> expected;
  for (const uint32_t place : all) {
    if ((place & 0xffff) % 3 != 0) expected.insert(place);
  }
  EXPECT_GT(all.size(), 100u);
  EXPECT_LT(expected.size(), all.size());
  EXPECT_EQ(rest, expected);
}

}  // namespace
}  // namespace arah
