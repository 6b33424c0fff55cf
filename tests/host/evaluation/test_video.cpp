// A video holds the pictures that it was made of, in order, over the background that was asked for.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <opencv2/videoio.hpp>

#include "host/evaluation/picture.h"
#include "host/evaluation/video.h"
#include "host/file_writing.h"
#include "host/input_error.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
constexpr int kWidth = 49, kHeight = 33;  // odd: the codecs want even sizes

// Left half opaque in one colour, right half transparent.
fs::path picture(const TemporaryFolder& folder, const std::string& name, const std::array<float, 3>& color, int width = kWidth) {
  std::vector<float> rgba;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < width; ++x) {
      rgba.insert(rgba.end(), color.begin(), color.end());
      rgba.push_back(x < width / 2 ? 1.0f : 0.0f);
    }
  const fs::path path = folder / name;
  write_file_safely(path, encode_png(rgba, width, kHeight, 4));
  return path;
}

TEST(VideoTest, HoldsItsPicturesInOrderOverTheBackground) {
  const TemporaryFolder folder;
  const std::vector<std::array<float, 3>> colors{{0.8f, 0.2f, 0.2f}, {0.2f, 0.7f, 0.3f}, {0.2f, 0.3f, 0.9f}, {0.9f, 0.9f, 0.1f}};
  std::vector<fs::path> pictures;
  for (size_t i = 0; i < colors.size(); ++i) pictures.push_back(picture(folder, std::to_string(i) + ".png", colors[i]));
  const std::string codec = write_video(folder / "clip.mp4", pictures, 12.5, {1, 0.5f, 0});
  std::printf("  codec: %s\n", codec.c_str());
  EXPECT_THAT(codec, testing::AnyOf("H.264", "MPEG-4 part 2"));

  cv::VideoCapture video((folder / "clip.mp4").string());
  ASSERT_TRUE(video.isOpened());
  EXPECT_NEAR(video.get(cv::CAP_PROP_FPS), 12.5, 1e-6);
  cv::Mat frame;
  const std::array<float, 3> background{1, 0.5f, 0};
  for (const std::array<float, 3>& color : colors) {
    ASSERT_TRUE(video.read(frame));
    ASSERT_EQ(frame.size(), cv::Size(kWidth + 1, kHeight + 1));
    const cv::Vec3b person = frame.at<cv::Vec3b>(16, 8), beside = frame.at<cv::Vec3b>(16, 40);
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(person[2 - static_cast<int>(c)], 255 * color[c], 12);  // what 4:2:0 and quantisation leave
      EXPECT_NEAR(beside[2 - static_cast<int>(c)], 255 * background[c], 12);
    }
  }
  EXPECT_FALSE(video.read(frame)) << "more frames than pictures";
}

TEST(VideoTest, IsWholeOrAbsent) {
  const TemporaryFolder folder;
  std::vector<fs::path> pictures{picture(folder, "0.png", {1, 0, 0}), picture(folder, "1.png", {1, 0, 0}, 60)};
  EXPECT_THROW(write_video(folder / "clip.mp4", pictures, 25, {0, 0, 0}), InputError) << "sizes differ";
  pictures[1] = folder / "absent.png";
  EXPECT_THROW(write_video(folder / "clip.mp4", pictures, 25, {0, 0, 0}), InputError);
  pictures.resize(1);
  EXPECT_THROW(write_video(folder / "no" / "folder" / "clip.mp4", pictures, 25, {0, 0, 0}), std::runtime_error);
  EXPECT_THROW(write_video(folder / "clip.mp4", {}, 25, {0, 0, 0}), std::invalid_argument);
  size_t files = 0;
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    EXPECT_EQ(entry.path().extension(), ".png") << entry.path();
    ++files;
  }
  EXPECT_EQ(files, 2u);
}

}  // namespace
}  // namespace arah
