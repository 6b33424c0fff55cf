#include <cmath>
#include <zlib.h>

#include "host/capture/inspect.h"
#include "tests/host/body/memory_of_refusal.h"
#include "tests/host/body/python_files.h"
#include "tests/host/capture/small_capture.h"

namespace arah {
namespace {

TEST(Capture, OpensAndListsWhatItHas) {
  const SmallCapture made;
  const Capture capture = open_capture(made.folder.path());
  EXPECT_EQ(capture.cameras.size(), 2u);
  EXPECT_EQ(capture.body_template.vertices.size(), 4u);
  EXPECT_EQ(motion_of(capture, "train").frames.size(), 3u);
  EXPECT_EQ(camera_index(capture, "right"), 1u);
  EXPECT_EQ(frames_with_images(capture, "train", 0), (std::vector<int>{3, 4}));
  expect_input_error([&] { motion_of(capture, "ood"); }, {"one of train", "'ood'"});
  expect_input_error([&] { camera_index(capture, "top"); }, {"one of left, right", "'top'"});
}

TEST(Capture, NamesTheFileThatIsMissingOrDoesNotFit) {
  expect_input_error([] { open_capture("/nowhere/at/all"); }, {"/nowhere/at/all", "no folder"});
  {
    const SmallCapture made;
    std::filesystem::remove(made.folder / "template.glb");
    expect_input_error([&] { open_capture(made.folder.path()); }, {"template.glb"});
  }
  {
    const SmallCapture made;
    std::filesystem::remove(made.folder / "motion_train.json");
    expect_input_error([&] { open_capture(made.folder.path()); }, {"motion_<split>.json", "none"});
  }
  {
    const SmallCapture made;
    std::filesystem::rename(made.folder / "motion_train.json", made.folder / "motion_ood.json");
    expect_input_error([&] { open_capture(made.folder.path()); }, {"motion_ood.json", "'ood'", "'train'"});
  }
  {
    SmallCapture made;
    made.motion.skeleton.names[2] = "wing";
    write_motion(made.folder / "motion_train.json", made.motion);
    expect_input_error([&] { open_capture(made.folder.path()); }, {"motion_train.json", "'wing'"});
  }
}

TEST(LoadImage, PremultipliesAndAveragesWholePixels) {
  const SmallCapture made;
  cv::Mat picture(30, 40, CV_8UC4);
  for (int v = 0; v < 30; ++v) {
    for (int u = 0; u < 40; ++u) {
      auto byte = [&](int k) { return static_cast<unsigned char>((37 * u + 91 * v + 53 * k + u * v) % 256); };
      picture.at<cv::Vec4b>(v, u) = cv::Vec4b(byte(0), byte(1), byte(2), byte(3));
    }
  }
  write_picture(made.picture_path("left", 3), picture);
  const Capture capture = open_capture(made.folder.path());
  for (int factor : {1, 2, 5}) {
    const Image image = load_image(capture, "train", 0, 3, 40 / factor);
    ASSERT_EQ(image.width, 40 / factor);
    ASSERT_EQ(image.height, 30 / factor);
    double largest = 0.0;
    for (int v = 0; v < image.height; ++v) {
      for (int u = 0; u < image.width; ++u) {
        for (int k = 0; k < 4; ++k) {
          double mean = 0.0;
          for (int dv = 0; dv < factor; ++dv) {
            for (int du = 0; du < factor; ++du) {
              const cv::Vec4b pixel = picture.at<cv::Vec4b>(v * factor + dv, u * factor + du);
              const double alpha = pixel[3] / 255.0;
              mean += (k == 3 ? alpha : alpha * pixel[2 - k] / 255.0) / (factor * factor);  // OpenCV stores BGRA
            }
          }
          const float value = image.rgba[static_cast<std::size_t>(4 * (v * image.width + u) + k)];
          largest = std::max(largest, std::abs(static_cast<double>(value) - mean));
        }
      }
    }
    EXPECT_LT(largest, 3e-7) << factor;
  }
  EXPECT_EQ(load_image(capture, "train", 0, 3).width, 40);
}

TEST(LoadImage, KeepsTheMeanAtAnyReduction) {
  Image image{40, 30, std::vector<float>(40 * 30 * 4)};
  for (std::size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] = static_cast<float>((i * i * 7) % 101) / 100.0f;
  auto mean = [](const Image& of) {
    double sum = 0.0;
    for (float value : of.rgba) sum += static_cast<double>(value);
    return sum / static_cast<double>(of.rgba.size());
  };
  for (int width : {1, 4, 12, 20, 28}) EXPECT_NEAR(mean(reduced(image, width)), mean(image), 1e-5) << width;
  EXPECT_THROW(reduced(image, 41), std::invalid_argument);
}

TEST(LoadImage, TakesTheDistortionOut) {
  SmallCapture made;
  Camera& camera = made.cameras[0];
  camera.distortion = {0.3, 0.05, 0.01, -0.02, 0.0};
  write_cameras(made.folder / "cameras.json", made.cameras);
  // Colours that vary linearly over the picture are exact under bilinear interpolation.
  cv::Mat picture(30, 40, CV_8UC4);
  for (int v = 0; v < 30; ++v) {
    for (int u = 0; u < 40; ++u) {
      picture.at<cv::Vec4b>(v, u) =
          cv::Vec4b(0, static_cast<unsigned char>(8 * v), static_cast<unsigned char>(6 * u), 255);
    }
  }
  write_picture(made.picture_path("left", 3), picture);
  const Image image = load_image(open_capture(made.folder.path()), "train", 0, 3);
  int compared = 0;
  for (int v = 0; v < 30; ++v) {
    for (int u = 0; u < 40; ++u) {
      const glm::dvec2 at = camera.distort({u, v});
      if (at.x < 0.0 || at.y < 0.0 || at.x > 39.0 || at.y > 29.0) continue;
      ++compared;
      const std::size_t first = static_cast<std::size_t>(4 * (v * 40 + u));
      // The remapping places samples on a grid of 1/32 pixel.
      EXPECT_NEAR(image.rgba[first] * 255.0 / 6.0, at.x, 1.0 / 32.0);
      EXPECT_NEAR(image.rgba[first + 1] * 255.0 / 8.0, at.y, 1.0 / 32.0);
    }
  }
  EXPECT_GT(compared, 500);
}

TEST(LoadImage, NamesTheFileThatCannotServe) {
  const SmallCapture made;
  const Capture capture = open_capture(made.folder.path());
  auto load = [&] { load_image(capture, "train", 0, 3); };
  const std::filesystem::path path = made.picture_path("left", 3);
  const std::string name = "left/000003.png";

  expect_input_error([&] { load_image(capture, "train", 0, 9); }, {"left/000009.png", "no file"});
  expect_input_error([&] { load_image(capture, "train", 0, 3, 41); }, {name, "1 to 40 columns", "41"});
  expect_input_error([&] { load_image(capture, "train", 0, 3, -1); }, {name, "-1"});

  std::ifstream file(path, std::ios::binary);
  const std::string whole((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  for (std::size_t size : {std::size_t{0}, std::size_t{5}, std::size_t{20}, whole.size() / 2, whole.size() - 1}) {
    made.folder.write("images/train/left/000003.png", whole.substr(0, size));
    expect_input_error(load, {name});
  }
  made.folder.write("images/train/left/000003.png", "\xff\xd8\xff not a PNG at all");
  expect_input_error(load, {name, "a PNG picture", "something else"});
  write_picture(path, cv::Mat(30, 40, CV_8UC3, cv::Scalar(1, 2, 3)));
  expect_input_error(load, {name, "alpha", "3 channels"});
  write_picture(path, cv::Mat(30, 41, CV_8UC4, cv::Scalar(1, 2, 3, 4)));
  expect_input_error(load, {name, "40x30", "'left'", "41x30"});
  made.folder.write("images/train/left/000003.png", whole);
  EXPECT_EQ(load_image(capture, "train", 0, 3).width, 40);
}

// A PNG's chunk with its checksum.
std::string png_chunk(const std::string& kind, const std::string& content) {
  const std::string checked = kind + content;
  const uLong sum = ::crc32(0, reinterpret_cast<const Bytef*>(checked.data()), static_cast<uInt>(checked.size()));
  const std::string length = python::little(content.size(), 4), checksum = python::little(sum, 4);
  return std::string(length.rbegin(), length.rend()) + checked + std::string(checksum.rbegin(), checksum.rend());
}
// All whole but for the rows, of which there are none.
std::string png_claiming(std::uint32_t width, std::uint32_t height) {
  const std::string w = python::little(width, 4), h = python::little(height, 4);
  return std::string("\x89PNG\r\n\x1a\n") + png_chunk("IHDR", std::string(w.rbegin(), w.rend()) + std::string(h.rbegin(), h.rend()) + std::string("\x08\x06\0\0\0", 5)) +
         png_chunk("IDAT", "\x78\x9c\x03" + std::string(1, '\0') + std::string("\0\0\0\1", 4)) + png_chunk("IEND", "");
}

TEST(LoadImage, HostilePicturesCostLittle) {
  const SmallCapture made;
  const Capture capture = open_capture(made.folder.path());
  const auto refuse = [&](const std::string& content, const std::string& part) {
    made.folder.write("images/train/left/000003.png", content);
    expect_input_error([&] { load_image(capture, "train", 0, 3); }, {"left/000003.png", part});
    EXPECT_LT(memory_of_refusal([&] { load_image(capture, "train", 0, 3); }), kMostMemoryOfRefusal) << part;
  };
  refuse(png_claiming(100'000, 100'000), "expected 1 to 8192 pixels each way, found 100000x100000");
  refuse(png_claiming(4'294'967'295, 1), "1 to 8192 pixels each way");
  refuse(png_claiming(0, 0), "1 to 8192 pixels each way");
  refuse(png_claiming(8192, 8192), "expected 40x30");  // before a pixel is asked for
  refuse(png_claiming(40, 30), "left/000003.png");
  // A second header behind the first, larger one.
  const std::string small = png_claiming(40, 30), large = png_claiming(30'000, 30'000);
  refuse(small.substr(0, 33) + large.substr(8), "left/000003.png");
  std::filesystem::resize_file(made.picture_path("left", 3), 300'000'000);
  expect_input_error([&] { load_image(capture, "train", 0, 3); }, {"left/000003.png", "bytes", "300000000"});
}

TEST(Inspect, TellsAGoodCaptureFromABadOne) {
  const SmallCapture made;
  const std::string good = inspect(made.folder.path());
  EXPECT_THAT(good,
              testing::HasSubstr("train left: 2 of 3 frames have pictures; template inside the mask: mean 100.00 %"));
  EXPECT_THAT(good, testing::HasSubstr("warning: train: frames without a picture: 9"));
  EXPECT_THAT(good, testing::Not(testing::HasSubstr("calibration")));
  EXPECT_THAT(good, testing::Not(testing::HasSubstr("not closed")));

  // A calibration that is off by half a picture, and an empty mask.
  std::vector<Camera> cameras = made.cameras;
  cameras[0].K[2][0] += 12.0;
  write_cameras(made.folder / "cameras.json", cameras);
  write_picture(made.picture_path("right", 4), cv::Mat(23, 37, CV_8UC4, cv::Scalar(0, 0, 0, 0)));
  made.folder.write("images/train/right/000003.png", "no picture");
  const std::string bad = inspect(made.folder.path());
  EXPECT_THAT(bad, testing::HasSubstr("warning: train left: only"));
  EXPECT_THAT(bad, testing::HasSubstr("warning: train right: empty masks in frames 4"));
  EXPECT_THAT(bad, testing::ContainsRegex("warning: .*right/000003.png: expected a PNG picture"));
}

TEST(Inspect, LooksAtSingleFiles) {
  const SmallCapture made;
  EXPECT_THAT(inspect(made.folder / "motion_train.json"), testing::HasSubstr("3 frames (3-4, 9), 3 joints"));
  EXPECT_THAT(inspect(made.folder / "template.glb"), testing::HasSubstr("4 vertices, 4 triangles, 3 joints"));
  EXPECT_THAT(inspect(made.folder / "cameras.json"), testing::HasSubstr("camera right (test): 37x23"));
  BodyTemplate open = made.body;
  open.triangles.pop_back();
  EXPECT_THAT(inspect_template(open), testing::HasSubstr("warning: the mesh is not closed: 3 open edges"));
  EXPECT_THAT(inspect_template(made.body), testing::Not(testing::HasSubstr("shape")));
  BodyTemplate shaped = made.body;
  shaped.shape.names = {"long"};
  shaped.shape.beta = {0.5};
  shaped.shape.vertex_offsets = {{{0, 0, 0}, {0, 0.3f, 0.4f}, {0, 0, 0}, {0, 0, 0}}};
  shaped.shape.joint_offsets = {{{0, 0, 0}, {0, 0, 0}, {0.02, 0, 0}}};
  EXPECT_THAT(inspect_template(shaped), testing::HasSubstr("shape 'long': a unit moves vertices by up to 500.0 mm, rest joints by up to 20.0 mm; 0.5 here"));
  Motion degrees = made.motion;
  degrees.frames[1].pose.theta[0].x = 45.0;
  EXPECT_THAT(inspect_motion(degrees), testing::HasSubstr("are the angles radians?"));
  EXPECT_THAT(inspect(made.folder.write("a.bvh", "HIERARCHY\nROOT Hips {\nOFFSET 0 0 0\nCHANNELS 1 Xposition\nJOINT Tail {\nOFFSET 0 1 0\nCHANNELS 0\n}\n}\n"
                                                 "MOTION\nFrames: 2\nFrame Time: 0.04\n1\n3\n")),
              testing::AllOf(testing::HasSubstr("BVH: 2 frames at 25 a second, 2 joints"), testing::HasSubstr("pelvis           Hips"), testing::HasSubstr("other names: Tail"),
                             testing::HasSubstr("through 2 x 0 x 0")));
  expect_input_error([&] { inspect(made.folder.write("notes.txt", "")); }, {"notes.txt", "'.txt'"});
  expect_input_error([&] { inspect(made.folder / "absent"); }, {"absent", "nothing of this name"});
}

TEST(Inspect, FindsTheSubjectInPlace) {
  if (!std::filesystem::exists(subject_a())) GTEST_SKIP() << "no capture at " << subject_a();
  const Capture capture = open_capture(subject_a());
  EXPECT_EQ(capture.motions.size(), 3u);
  EXPECT_EQ(frames_with_images(capture, "train", 0).size(), 60u);
  EXPECT_EQ(frames_with_images(capture, "train", 4).size(), 10u);
  const std::string report = inspect_capture(capture, 2);
  std::printf("%s", report.c_str());
  EXPECT_THAT(report, testing::Not(testing::HasSubstr("warning:")));
  // The clothed body lies inside the region that is measured.
  const Image image = load_image(capture, "novel", 5, 70, 128);
  const PixelMask box =
      projected_box_mask(capture.cameras[5].scaled(128),
                         posed_vertices(capture.body_template, find_frame(motion_of(capture, "novel"), 70)->pose));
  int outside = 0;
  for (std::size_t i = 0; i < box.inside.size(); ++i)
    outside += image.rgba[4 * i + 3] >= 0.5f && box.inside[i] == 0 ? 1 : 0;
  EXPECT_EQ(outside, 0);
}

}  // namespace
}  // namespace arah
