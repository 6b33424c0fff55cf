// An avatar in motion and for other programs, as a user asks for it: videos and pictures, interrupted and gone on with; exports.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <thread>

#include "host/body/motion.h"
#include "host/capture/camera.h"
#include "tests/host/body/glb_reader.h"
#include "tests/host/body/rigs.h"
#include "tests/stories/program.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class AnimationStory : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    const Outcome made = arah({"synth", at("capture"), "--frames", "6", "--size", "48"});
    ASSERT_EQ(made.code, 0) << made.errors;
    const Outcome trained = arah({"train", at("capture"), "-o", at("run"), "--steps", "2", "--set", "fit_steps=150", "--set", "fit_skinning_steps=100"});
    ASSERT_EQ(trained.code, 0) << trained.errors;
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }
  static std::string at(const std::string& name) { return (*folder_ / name).string(); }
  static Outcome arah(const std::vector<std::string>& words) { return Program(words, folder_->path()).wait(); }
  static size_t pictures(const std::string& name) {
    size_t count = 0;
    if (fs::exists(at(name)))
      for (const auto& entry : fs::directory_iterator(at(name))) count += entry.path().extension() == ".png" && entry.path().filename().string()[0] != '.';
    return count;
  }
  static void expect_refused(const std::vector<std::string>& words, const std::string& part) {
    const Outcome outcome = arah(words);
    EXPECT_EQ(outcome.code, 2) << outcome.errors;
    EXPECT_THAT(outcome.errors, HasSubstr(part));
  }

 private:
  static TemporaryFolder* folder_;
};

TemporaryFolder* AnimationStory::folder_ = nullptr;

TEST_F(AnimationStory, GoesOnAfterCtrlCToTheSamePictures) {
  const std::vector<std::string> turn{"animate", at("run"), "-o", at("turn.mp4"), "--turntable", "--count", "8", "--size", "40", "--beside", "normals", "--fps", "10", "--keep-frames"};
  {
    Program program(turn, fs::path(at("")));
    while (program.running() && pictures("turn.mp4.frames") < 2) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    program.signal(SIGINT);
    const Outcome outcome = program.wait();
    ASSERT_EQ(outcome.code, 1) << outcome.errors;
    EXPECT_THAT(outcome.errors, HasSubstr("the same call goes on"));
  }
  const size_t before = pictures("turn.mp4.frames");
  ASSERT_GE(before, 2u);
  ASSERT_LT(before, 8u);
  EXPECT_FALSE(fs::exists(at("turn.mp4")));
  const std::string first = read_all(at("turn.mp4.frames/000000.png"));
  const auto written = fs::last_write_time(at("turn.mp4.frames/000000.png"));

  // Other settings are no continuation.
  std::vector<std::string> other = turn;
  other[8] = "44";
  expect_refused(other, "size: expected");

  const Outcome whole = arah(turn);
  ASSERT_EQ(whole.code, 0) << whole.errors;
  EXPECT_THAT(whole.errors, HasSubstr(std::to_string(before) + " of 8 frames are there"));
  EXPECT_EQ(fs::last_write_time(at("turn.mp4.frames/000000.png")), written) << "made again";

  // Without an interruption, into a folder: the same bits.
  const Outcome folder = arah({"animate", at("run"), "-o", at("turn"), "--turntable", "--count", "8", "--size", "40", "--beside", "normals"});
  ASSERT_EQ(folder.code, 0) << folder.errors;
  ASSERT_EQ(pictures("turn"), 8u);
  for (const char* name : {"000000.png", "000003.png", "000007.png"}) EXPECT_EQ(read_all(at("turn") + "/" + name), read_all(at("turn.mp4.frames") + "/" + name)) << name;

  // The camera has gone round, the person stands in the middle of both halves, colour left and normals right.
  const cv::Mat front = cv::imread(at("turn/000000.png"), cv::IMREAD_UNCHANGED), back = cv::imread(at("turn/000004.png"), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(front.size(), cv::Size(80, 40));
  ASSERT_EQ(front.type(), CV_8UC4);
  EXPECT_EQ(front.at<cv::Vec4b>(0, 0)[3], 0);
  EXPECT_GT(front.at<cv::Vec4b>(15, 20)[3], 200);
  EXPECT_GT(front.at<cv::Vec4b>(15, 60)[3], 200);
  EXPECT_GT(front.at<cv::Vec4b>(15, 60)[0], 180) << "at rest +z faces the camera: blue";
  EXPECT_LT(back.at<cv::Vec4b>(15, 60)[0], 75);

  cv::VideoCapture video(at("turn.mp4"));
  ASSERT_TRUE(video.isOpened());
  EXPECT_NEAR(video.get(cv::CAP_PROP_FPS), 10, 1e-6);
  cv::Mat frame;
  int frames = 0;
  for (; video.read(frame); ++frames) EXPECT_EQ(frame.size(), cv::Size(80, 40));
  EXPECT_EQ(frames, 8);
}

TEST_F(AnimationStory, FollowsAMotionFromACamera) {
  const Outcome seen = arah({"animate", at("run"), "-o", at("seen.mp4"), "--capture", at("capture"), "--split", "train", "--camera", "cam_05", "--every", "2", "--quality", "fast"});
  ASSERT_EQ(seen.code, 0) << seen.errors;
  EXPECT_TRUE(fs::exists(at("seen.mp4")));
  EXPECT_FALSE(fs::exists(at("seen.mp4.frames"))) << "pictures that nobody asked for";

  // The same as `render` makes of one of its frames.
  const Outcome folder = arah({"animate", at("run"), "-o", at("one"), "--capture", at("capture"), "--camera", "cam_05", "--every", "2", "--count", "2"});
  ASSERT_EQ(folder.code, 0) << folder.errors;
  const Outcome rendered = arah({"render", at("run"), "-o", at("rendered.png"), "--capture", at("capture"), "--camera", "cam_05", "--frame", "2"});
  ASSERT_EQ(rendered.code, 0) << rendered.errors;
  EXPECT_EQ(pictures("one"), 2u);
  EXPECT_EQ(read_all(at("one/000001.png")), read_all(at("rendered.png")));

  // A path of the camera, one a picture.
  std::vector<Camera> path = read_cameras(at("capture/cameras.json"));
  path.resize(2);
  path[1] = path[0];
  path[1].name = "next";
  path[1].T.z += 0.5;
  write_cameras(at("path.json"), path);
  const std::vector<std::string> along{"animate", at("run"), "-o", at("along"), "--motion", at("capture/motion_train.json"), "--cameras", at("path.json"), "--quality", "fast"};
  expect_refused(along, "6, one a picture");
  std::vector<std::string> two = along;
  two.insert(two.end(), {"--count", "2"});
  const Outcome moved = arah(two);
  ASSERT_EQ(moved.code, 0) << moved.errors;
  const auto covered = [&](const char* name) {
    const cv::Mat picture = cv::imread(at("along") + "/" + name, cv::IMREAD_UNCHANGED);
    int count = 0;
    for (int y = 0; y < picture.rows; ++y)
      for (int x = 0; x < picture.cols; ++x) count += picture.at<cv::Vec4b>(y, x)[3] > 127;
    return count;
  };
  EXPECT_LT(covered("000001.png"), 0.9 * covered("000000.png")) << "the camera went back by half a metre";
}

TEST_F(AnimationStory, LeavesForOtherPrograms) {
  const Outcome exported = arah({"export", at("run"), "-o", at("person.glb"), "--capture", at("capture"), "--cell", "0.03", "--texture-size", "256", "--fps", "10"});
  ASSERT_EQ(exported.code, 0) << exported.errors;
  EXPECT_THAT(exported.output, HasSubstr("beyond the fourth"));
  const std::string bytes = read_all(at("person.glb"));
  const GlbReader file({bytes.begin(), bytes.end()});
  EXPECT_THAT(file.complaints(), testing::IsEmpty());
  EXPECT_EQ(file.json["animations"][0]["name"], "train");
  EXPECT_EQ(file.json["images"].size(), 1u);
  // At rest and in motion the person stands upright in the file, some 1.7 m tall.
  for (const std::optional<double> seconds : {std::optional<double>(), std::optional(0.2)}) {
    glm::dvec3 low(10.0), high(-10.0);
    for (const glm::dvec3& p : file.posed(seconds)) low = glm::min(low, p), high = glm::max(high, p);
    EXPECT_GT(high.y - low.y, 1.4);
    EXPECT_LT(high.y - low.y, 2.4);
    EXPECT_LT(high.z - low.z, 1.3);
  }
  if (const auto report = khronos_report(at("person.glb"))) EXPECT_EQ((*report)["issues"]["numErrors"], 0) << (*report)["issues"].dump(1);
  else std::printf("  not validated: neither gltf_validator nor node's package gltf-validator is installed\n");

  const Outcome meshes = arah({"export", at("run"), "-o", at("meshes"), "--format", "ply", "--capture", at("capture"), "--every", "3", "--cell", "0.03"});
  ASSERT_EQ(meshes.code, 0) << meshes.errors;
  for (const char* name : {"meshes/000000.ply", "meshes/000003.ply"}) EXPECT_THAT(read_all(at(name)), AllOf(testing::StartsWith("ply\n"), HasSubstr("property uchar red"), HasSubstr("element face")));
  // A frame that is missing is made again, the others stay; other options are refused before anything is mixed.
  const std::string third = read_all(at("meshes/000003.ply"));
  const auto written = fs::last_write_time(at("meshes/000000.ply"));
  fs::remove(at("meshes/000003.ply"));
  const std::vector<std::string> again{"export", at("run"), "-o", at("meshes"), "--format", "ply", "--capture", at("capture"), "--every", "3", "--cell"};
  std::vector<std::string> same = again, coarser = again;
  same.push_back("0.03");
  coarser.push_back("0.04");
  const Outcome went_on = arah(same);
  ASSERT_EQ(went_on.code, 0) << went_on.errors;
  EXPECT_EQ(read_all(at("meshes/000003.ply")), third);
  EXPECT_EQ(fs::last_write_time(at("meshes/000000.ply")), written);
  expect_refused(coarser, "export.json: cell");
  const Outcome object = arah({"export", at("run"), "-o", at("rest.obj"), "--cell", "0.03", "--colors", "none"});
  ASSERT_EQ(object.code, 0) << object.errors;
  EXPECT_THAT(read_all(at("rest.obj")), HasSubstr("\nf "));
  const Outcome cloud = arah({"export", at("run"), "-o", at("cloud.ply"), "--cell", "0.03", "--points", "1234"});
  ASSERT_EQ(cloud.code, 0) << cloud.errors;
  EXPECT_THAT(read_all(at("cloud.ply")), AllOf(HasSubstr("element vertex 1234\n"), testing::Not(HasSubstr("element face"))));

  expect_refused({"export", at("run"), "-o", at("no.stl")}, "'.stl'");
  expect_refused({"export", at("run"), "-o", at("no.glb"), "--points", "5"}, "--points");
  expect_refused({"export", at("run"), "-o", at("no.obj"), "--colors", "texture"}, "Textures go into a .glb");
  expect_refused({"export", at("run"), "-o", at("no.ply"), "--capture", at("capture")}, "--frame");
  expect_refused({"export", at("run"), "-o", at("no.glb"), "--code", "99"}, "--code");
}

// A motion that states its rate is shown and exported at it; an export's animation is a motion again, and the same.
TEST_F(AnimationStory, KeepsTheMotionsPaceAndItsPoses) {
  Motion motion = read_motion(at("capture/motion_train.json"));
  motion.frames_per_second = 12;
  write_motion(at("paced.json"), motion);
  const Outcome shown = arah({"animate", at("run"), "-o", at("paced.mp4"), "--motion", at("paced.json"), "--every", "2", "--size", "32", "--quality", "preview"});
  ASSERT_EQ(shown.code, 0) << shown.errors;
  cv::VideoCapture video(at("paced.mp4"));
  ASSERT_TRUE(video.isOpened());
  EXPECT_NEAR(video.get(cv::CAP_PROP_FPS), 6, 1e-6);

  const Outcome exported = arah({"export", at("run"), "-o", at("paced.glb"), "--motion", at("paced.json"), "--cell", "0.05", "--colors", "none"});
  ASSERT_EQ(exported.code, 0) << exported.errors;
  const Outcome inspected = arah({"inspect", at("paced.glb")});
  ASSERT_EQ(inspected.code, 0) << inspected.errors;
  EXPECT_THAT(inspected.output, AllOf(HasSubstr("template: "), HasSubstr("glTF animation 'paced': 6 frames at 12 a second, 24 joints")));
  const Outcome imported = arah({"import", "motion", at("paced.glb"), at("back.json"), "--body", at("run/avatar.safetensors"), "--animation", "paced"});
  ASSERT_EQ(imported.code, 0) << imported.errors;
  const Motion back = read_motion(at("back.json"));
  EXPECT_EQ(back.frames_per_second, 12.0);
  ASSERT_EQ(back.frames.size(), motion.frames.size());
  ASSERT_EQ(back.skeleton.names, motion.skeleton.names);
  for (size_t f = 0; f < back.frames.size(); ++f) {
    const Pose &a = motion.frames[f].pose, &b = back.frames[f].pose;
    EXPECT_LT(glm::distance(a.root_position, b.root_position), 1e-5) << f;
    for (size_t j = 0; j < a.theta.size(); ++j)
      EXPECT_LT(glm::length(axis_angle_from_rotation(glm::transpose(rotation_from_axis_angle(a.theta[j])) * rotation_from_axis_angle(b.theta[j]))), 1e-5) << f << " " << j;
  }
  expect_refused({"import", "motion", at("paced.glb"), at("no.json"), "--body", at("run/avatar.safetensors"), "--animation", "other"}, "one of 'paced'");
  expect_refused({"import", "motion", at("paced.json"), at("no.json"), "--body", at("run/avatar.safetensors"), "--animation", "paced"}, "--animation");
}

TEST_F(AnimationStory, SaysWhatIsWrongWithTheCall) {
  expect_refused({"animate", at("run"), "-o", at("no.mp4")}, "--turntable");
  expect_refused({"animate", at("run"), "-o", at("no.avi"), "--turntable"}, ".mp4");
  expect_refused({"animate", at("run"), "-o", at("no.mp4"), "--turntable", "--frame", "2"}, "--capture or --motion");
  expect_refused({"animate", at("run"), "-o", at("no.mp4"), "--capture", at("capture"), "--frame", "77"}, "one of 6 frames");
  EXPECT_FALSE(fs::exists(at("no.mp4.frames")));
}

}  // namespace
}  // namespace arah
