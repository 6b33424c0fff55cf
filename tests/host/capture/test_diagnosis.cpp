// A capture that is right gets no warning; broken in one way, it is told that way.
#include "host/capture/diagnosis.h"

#include <functional>
#include <glm/matrix.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "host/capture/inspect.h"
#include "host/capture/synthetic_capture.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

glm::dmat3 mirrored(int axis) {
  glm::dmat3 m(1.0);
  m[axis][axis] = -1.0;
  return m;
}

// A world turned so that what was up is ahead or the like.
void turn_motion(Motion& motion, const glm::dmat3& turn) {
  for (MotionFrame& frame : motion.frames) {
    frame.pose.root_position = turn * frame.pose.root_position;
    frame.pose.theta[0] = axis_angle_from_rotation(turn * rotation_from_axis_angle(frame.pose.theta[0]));
  }
}

class DiagnosisTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_synthetic_capture(folder_->path() / "good", {{}, 24, 128});
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }

  void SetUp() override { capture = open_capture(folder_->path() / "good"); }

  std::vector<std::string> warnings(int pictures = 2) const {
    const CaptureInspection found = examine_capture(capture, pictures);
    for (const std::string& warning : found.warnings()) std::printf("%s\n", warning.c_str());
    return found.warnings();
  }
  void each_camera(const std::function<void(Camera&)>& spoil) { for (Camera& camera : capture.cameras) spoil(camera); }
  void each_motion(const std::function<void(Motion&)>& spoil) { for (auto& [split, motion] : capture.motions) spoil(motion); }
  // A copy of the capture whose pictures (BGRA, 8 bits) are changed.
  void each_picture(const std::function<void(cv::Mat&)>& spoil, const std::string& of = "") {
    capture.path = folder_->path() / "spoiled";
    std::filesystem::remove_all(capture.path);
    std::filesystem::copy(folder_->path() / "good", capture.path, std::filesystem::copy_options::recursive);
    for (const auto& entry : std::filesystem::recursive_directory_iterator(capture.path / "images")) {
      if (!entry.is_regular_file() || entry.path().string().find(of) == std::string::npos) continue;
      cv::Mat picture = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
      spoil(picture);
      ASSERT_TRUE(cv::imwrite(entry.path().string(), picture));
    }
  }

  Capture capture;

 private:
  inline static TemporaryFolder* folder_ = nullptr;
};

TEST_F(DiagnosisTest, OfAGoodCaptureNothingIsSaid) {
  const CaptureInspection found = examine_capture(capture, 12);
  EXPECT_THAT(found.warnings(), IsEmpty());
  EXPECT_EQ(found.views.size(), 16u);
  for (const InspectedView& view : found.views) {
    EXPECT_GT(view.measured, 0);
    EXPECT_GT(view.inside, 0.99);
    EXPECT_GT(view.overlap, 0.6) << view.split << " " << view.camera;
  }
}

TEST_F(DiagnosisTest, CamerasInMillimetres) {
  each_camera([](Camera& camera) { camera.T *= 1000.0; });
  EXPECT_THAT(warnings(), ElementsAre(AllOf(HasSubstr("T of cameras.json is in millimetres"), HasSubstr("all pictures: "), HasSubstr("with T times 0.001"))));
}

TEST_F(DiagnosisTest, CamerasInCentimetres) {
  each_camera([](Camera& camera) { camera.T *= 100.0; });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("T of cameras.json is in centimetres")));
}

TEST_F(DiagnosisTest, AMotionInMillimetres) {
  each_motion([](Motion& motion) { for (MotionFrame& frame : motion.frames) frame.pose.root_position *= 1000.0; });
  // A motion that goes so far is noticed without cameras too.
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("is the unit metres?"), HasSubstr("is the unit metres?"), HasSubstr("root positions of the motion are in millimetres")));
}

TEST_F(DiagnosisTest, OneMotionOfTwoInMillimetres) {
  for (MotionFrame& frame : capture.motions.at("novel").frames) frame.pose.root_position *= 1000.0;
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("is the unit metres?"), AllOf(HasSubstr("split novel: "), HasSubstr("root positions of the motion are in millimetres"))));
}

TEST_F(DiagnosisTest, CamerasAndMotionInMillimetres) {
  each_camera([](Camera& camera) { camera.T *= 1000.0; });
  each_motion([](Motion& motion) { for (MotionFrame& frame : motion.frames) frame.pose.root_position *= 1000.0; });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("is the unit metres?"), HasSubstr("is the unit metres?"), HasSubstr("T of cameras.json and the motion's root positions are in millimetres")));
}

TEST_F(DiagnosisTest, TransposedRotations) {
  each_camera([](Camera& camera) { camera.R = glm::transpose(camera.R); });
  EXPECT_THAT(warnings(), ElementsAre(AllOf(HasSubstr("R of cameras.json is transposed"), HasSubstr("with R transposed"))));
}

TEST_F(DiagnosisTest, TheRotationOfOneCameraTransposed) {
  capture.cameras[2].R = glm::transpose(capture.cameras[2].R);
  EXPECT_THAT(warnings(), ElementsAre(AllOf(HasSubstr("camera cam_02: "), HasSubstr("R of cameras.json is transposed"))));
}

TEST_F(DiagnosisTest, TheCamerasPlaceForTheTranslation) {
  each_camera([](Camera& camera) { camera.T = camera.center(); });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr(": T of cameras.json is the camera's place in the world")));
}

TEST_F(DiagnosisTest, FromTheCameraToTheWorld) {
  each_camera([](Camera& camera) {
    camera.T = camera.center();
    camera.R = glm::transpose(camera.R);
  });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("R and T of cameras.json go from the camera to the world")));
}

TEST_F(DiagnosisTest, OpenGlsCameraAxes) {
  const glm::dmat3 flip(1, 0, 0, 0, -1, 0, 0, 0, -1);
  each_camera([&](Camera& camera) {
    camera.R = flip * camera.R;
    camera.T = flip * camera.T;
  });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr(": the cameras have OpenGL's axes")));
  // Blender's own: those, and from the camera to the world.
  each_camera([](Camera& camera) {
    camera.T = camera.center();
    camera.R = glm::transpose(camera.R);
  });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("go from the camera to the world, where world to camera belongs; and the cameras have OpenGL's axes")));
}

TEST_F(DiagnosisTest, AMotionWithYUp) {
  each_motion([](Motion& motion) { turn_motion(motion, glm::dmat3(1, 0, 0, 0, 0, -1, 0, 1, 0)); });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("the motion has +Y up and the cameras +Z")));
}

TEST_F(DiagnosisTest, CamerasWithYUp) {
  const glm::dmat3 to_y_up(1, 0, 0, 0, 0, -1, 0, 1, 0);
  each_camera([&](Camera& camera) { camera.R = camera.R * glm::transpose(to_y_up); });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("the motion has +Z up and the cameras +Y")));
}

TEST_F(DiagnosisTest, AMotionOfTheOtherHand) {
  each_motion([](Motion& motion) {
    for (MotionFrame& frame : motion.frames) {
      frame.pose.root_position = mirrored(0) * frame.pose.root_position;
      for (glm::dvec3& theta : frame.pose.theta) theta = {theta.x, -theta.y, -theta.z};
    }
  });
  EXPECT_THAT(warnings(), ElementsAre(AllOf(HasSubstr("of the other hand"), HasSubstr("with the motion's (-x, y, z) for the cameras' (x, y, z)"))));
}

TEST_F(DiagnosisTest, ACalibrationOfTheOtherHand) {
  each_camera([](Camera& camera) {
    camera.R = mirrored(1) * camera.R * mirrored(0);
    camera.T = mirrored(1) * camera.T;
  });
  EXPECT_THAT(warnings(), ElementsAre(AllOf(HasSubstr("left-handed world"), HasSubstr("y of the cameras and x of their world mirrored"))));
}

TEST_F(DiagnosisTest, MirroredPictures) {
  each_picture([](cv::Mat& picture) {
    cv::Mat flipped(picture.size(), picture.type());
    for (int x = 0; x < picture.cols; ++x) picture.col(x).copyTo(flipped.col(picture.cols - 1 - x));
    picture = flipped;
  });
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("the pictures are mirrored")));
}

TEST_F(DiagnosisTest, IntrinsicsOfAnotherSize) {
  const std::vector<Camera> good = capture.cameras;
  for (const double factor : {2.0, 0.5, 1.3}) {
    capture.cameras = good;
    each_camera([&](Camera& camera) {
      for (int k = 0; k < 2; ++k) {
        camera.K[k][k] *= factor;
        camera.K[2][k] = factor * (camera.K[2][k] + 0.5) - 0.5;
      }
    });
    const std::vector<std::string> found = warnings();
    EXPECT_THAT(found, ElementsAre(AllOf(HasSubstr("K of cameras.json is for pictures "), HasSubstr(fmt::format("with K times {:.3g}, ", 1.0 / factor))))) << factor;
  }
}

TEST_F(DiagnosisTest, InvertedMasks) {
  const auto invert = [](cv::Mat& picture) {
    for (int y = 0; y < picture.rows; ++y)
      for (int x = 0; x < picture.cols; ++x) picture.at<cv::Vec4b>(y, x)[3] ^= 255;
  };
  each_picture(invert);
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("all pictures: the masks are inverted")));
  each_picture(invert, "cam_03");
  EXPECT_THAT(warnings(), ElementsAre(HasSubstr("camera cam_03: the masks are inverted")));
}

TEST_F(DiagnosisTest, EmptyAndFullMasks) {
  for (const int alpha : {0, 255}) {
    each_picture([&](cv::Mat& picture) {
      for (int y = 0; y < picture.rows; ++y)
        for (int x = 0; x < picture.cols; ++x) picture.at<cv::Vec4b>(y, x)[3] = static_cast<std::uint8_t>(alpha);
    }, "train/cam_01");
    EXPECT_THAT(warnings(), ElementsAre(AllOf(HasSubstr("train cam_01: "), HasSubstr(alpha == 0 ? "empty masks in frames" : "masks that fill the whole picture in frames"))));
  }
}

TEST_F(DiagnosisTest, PicturesAndPosesOutOfStep) {
  const Capture good = capture;
  for (const int shift : {1, 3, -4}) {
    capture = good;
    each_motion([&](Motion& motion) {
      const std::vector<MotionFrame> frames = motion.frames;
      const auto count = static_cast<int>(frames.size());
      for (int f = 0; f < count; ++f) motion.frames[static_cast<std::size_t>(f)].pose = frames[static_cast<std::size_t>(std::clamp(f - shift, 0, count - 1))].pose;
    });
    EXPECT_THAT(warnings(6), ElementsAre(AllOf(HasSubstr("out of step"), HasSubstr(fmt::format("{} frame{} {} its own", std::abs(shift), std::abs(shift) == 1 ? "" : "s", shift > 0 ? "after" : "before"))))) << shift;
  }
}

// What explains one camera does not hide that another is off.
TEST_F(DiagnosisTest, OneCameraIsExplainedAndAnotherIsOff) {
  capture.cameras[1].R = glm::transpose(capture.cameras[1].R);
  capture.cameras[3].T += glm::dvec3(0.5, -0.4, 0.9);
  EXPECT_THAT(warnings(), ElementsAre(AllOf(HasSubstr("camera cam_01: "), HasSubstr("R of cameras.json is transposed")), AllOf(HasSubstr("novel cam_03: only "), HasSubstr("are off")), HasSubstr("train cam_03: only ")));
}

// A body that is simply elsewhere is said to be off, and none of the causes is blamed.
TEST_F(DiagnosisTest, WhatNothingExplainsIsSaidToBeOff) {
  each_motion([](Motion& motion) { for (MotionFrame& frame : motion.frames) frame.pose.root_position += glm::dvec3(0.21, -0.17, 0.12); });
  const std::vector<std::string> found = warnings();
  EXPECT_THAT(found, testing::Not(IsEmpty()));
  for (const std::string& warning : found) EXPECT_THAT(warning, HasSubstr("calibration, poses or masks are off"));
}

}  // namespace
}  // namespace arah
