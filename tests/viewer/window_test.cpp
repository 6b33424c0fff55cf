// The program in a real window, with real events.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "host/avatar/avatar_file.h"
#include "host/body/motion.h"
#include "host/capture/camera.h"
#include "tests/host/rendering/capsule_scene.h"
#include "tests/viewer/desktop.h"
#include "viewer/view_state.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using Event = ViewerOnDesktop::Event;

// Of all tests: an avatar's file, and a motion of it.
class WindowTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (!desktop_missing().empty()) return;
    folder() = fs::temp_directory_path() / fmt::format("arah_window_{}", ::getpid());
    fs::create_directories(folder());
    save_avatar(folder() / "capsule.safetensors", capsule_avatar(test_device(), small_paper_spec()));
    Motion motion;
    motion.split = "wave";
    motion.skeleton = capsule_body().skeleton;
    motion.frames_per_second = 2;  // six seconds around, so that a slow machine does not come back to where it began
    for (int frame = 0; frame < 12; ++frame) {
      Pose pose = rest_pose(motion.skeleton);
      pose.theta[1] = {0, 0, 0.1 * frame};
      pose.theta[2] = {0, 0, -0.05 * frame};
      motion.frames.push_back({frame, pose, ""});
    }
    write_motion(folder() / "motion_wave.json", motion);
  }
  static void TearDownTestSuite() {
    std::error_code error;
    fs::remove_all(folder(), error);
  }
  void SetUp() override {
    if (const std::string missing = desktop_missing(); !missing.empty()) GTEST_SKIP() << missing;
    own_ = folder() / testing::UnitTest::GetInstance()->current_test_info()->name();
    fs::create_directories(own_ / "out");
    desktop_ = std::make_unique<Desktop>(900, 700, own_ / "screen");
  }

  std::vector<std::string> words(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> all{(folder() / "capsule.safetensors").string(), "--motion", (folder() / "motion_wave.json").string(), "--out", (own_ / "out").string(), "--width", "700", "--height", "420", "--quality", "fast"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  // The hint of a first run would lie over the picture.
  std::unique_ptr<ViewerOnDesktop> opened(const std::vector<std::string>& more = {}, bool hint = false) {
    ::setenv("XDG_STATE_HOME", (own_ / "states").c_str(), 1);
    if (!hint) {
      fs::create_directories(own_ / "states" / "arah");
      std::ofstream(own_ / "states" / "arah" / "hint-seen").flush();
    }
    return std::make_unique<ViewerOnDesktop>(*desktop_, words(more), own_);
  }
  // What is right of the panels, without the mouse's arrow.
  cv::Mat picture() const {
    desktop_->hands("mousemove 880 680 sleep 0.2");
    return desktop_->screen()(cv::Rect(310, 0, 380, 380)).clone();
  }
  // Share of the pixels that differ visibly.
  static double changed(const cv::Mat& a, const cv::Mat& b) {
    cv::Mat difference, grey;
    cv::absdiff(a, b, difference);
    cv::cvtColor(difference, grey, cv::COLOR_BGR2GRAY);
    return static_cast<double>(cv::countNonZero(grey > 8)) / static_cast<double>(grey.total());
  }
  // Until the screen shows what the last event says: it is told before it is drawn.
  static void a_moment() { std::this_thread::sleep_for(std::chrono::milliseconds(400)); }
  void ends_well(ViewerOnDesktop& viewer) {
    const Outcome outcome = viewer.close();
    EXPECT_EQ(outcome.code, 0) << outcome.errors;
    EXPECT_THAT(outcome.errors, testing::Not(testing::HasSubstr("validation")));
    const std::vector<Event> events = viewer.events();
    ASSERT_FALSE(events.empty());
    EXPECT_EQ(events.back().at("event"), "closed");
    EXPECT_EQ(events.back().at("validation_messages"), 0);
  }
  // Where a widget is, from the last layout that was told.
  static std::pair<double, double> widget(const ViewerOnDesktop& viewer, const std::string& name) {
    std::pair<double, double> at{-1, -1};
    for (const Event& event : viewer.events())
      if (event.at("event") == "layout" && event.at("widgets").contains(name)) at = {event.at("widgets").at(name)[0], event.at("widgets").at(name)[1]};
    if (at.first < 0) throw std::runtime_error("no widget " + name);
    return at;
  }

  static fs::path& folder() {
    static fs::path path;
    return path;
  }
  fs::path own_;
  std::unique_ptr<Desktop> desktop_;
};

TEST_F(WindowTest, TurnsUnderTheHandAndRefinesAtRest) {
  const auto viewer = opened();
  viewer->wait_for("open");
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat before = picture();
  EXPECT_GT(changed(before, cv::Mat(before.size(), CV_8UC3, cv::Scalar(31, 28, 28))), 0.02) << "nothing is seen";
  viewer->drag(500, 200, 620, 230);
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat turned = picture();
  EXPECT_GT(changed(before, turned), 0.01);
  viewer->drag(500, 200, 540, 160, 3);
  viewer->wait_for_rest();
  a_moment();
  EXPECT_GT(changed(turned, picture()), 0.01) << "the right button moves";
  viewer->key("f");
  viewer->wait_for_rest();
  a_moment();
  EXPECT_EQ(changed(before, picture()), 0) << "F brings the first view back";
  ends_well(*viewer);
}

TEST_F(WindowTest, AFirstRunHasAHintThatGoesAwayForGood) {
  {
    const auto viewer = opened({}, true);
    viewer->wait_for_rest();
    a_moment();
    const cv::Mat hinted = picture();
    viewer->click(600, 390);
    a_moment();
    EXPECT_GT(changed(hinted, picture()), 0.002);
    ends_well(*viewer);
  }
  EXPECT_TRUE(fs::exists(own_ / "states" / "arah" / "hint-seen"));
}

TEST_F(WindowTest, PlaysAndPauses) {
  const auto viewer = opened();
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat first = picture();
  const auto [x, y] = widget(*viewer, "play");
  viewer->click(x, y);
  for (int i = 0; i < 5; ++i) viewer->wait_for("picture");
  std::this_thread::sleep_for(std::chrono::milliseconds(1200));
  viewer->key("space");
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat paused = picture();
  EXPECT_GT(changed(first, paused), 0.001) << "wherever the pause found it";
  std::this_thread::sleep_for(std::chrono::seconds(1));
  EXPECT_EQ(changed(paused, picture()), 0) << "it plays on";
  viewer->key("Right Right Right Right");
  viewer->wait_for_rest();
  a_moment();
  EXPECT_GT(changed(paused, picture()), 0.002) << "four frames on";
  ends_well(*viewer);
}

TEST_F(WindowTest, AJointIsDraggedAndLetGoAgain) {
  const auto viewer = opened();
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat before = picture();
  viewer->key("j");
  const Event joints = viewer->wait_for("joints");
  const double x = joints.at("at").at("bone_2")[0], y = joints.at("at").at("bone_2")[1];
  viewer->drag(x, y, x + 60, y + 10);
  viewer->wait_for_rest();
  viewer->key("j");
  a_moment();
  const cv::Mat bent = picture();
  EXPECT_GT(changed(before, bent), 0.01);
  viewer->key("ctrl+z");
  viewer->wait_for_rest();
  a_moment();
  EXPECT_EQ(changed(before, picture()), 0) << "undone";
  viewer->key("ctrl+y");
  viewer->wait_for_rest();
  a_moment();
  EXPECT_EQ(changed(bent, picture()), 0) << "done again";
  ends_well(*viewer);
}

TEST_F(WindowTest, ASliderPosesTheChosenJoint) {
  const auto viewer = opened();
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat before = picture();
  auto [x, y] = widget(*viewer, "Pose and shape");
  viewer->click(x, y);
  a_moment();
  std::tie(x, y) = widget(*viewer, "z");
  viewer->drag(x, y, x + 40, y);
  viewer->wait_for_rest();
  a_moment();
  EXPECT_GT(changed(before, picture()), 0.01);
  ends_well(*viewer);
}

TEST_F(WindowTest, LayersAreShownAndComeBack) {
  const auto viewer = opened();
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat color = picture();
  std::vector<cv::Mat> seen{color};
  for (int layer = 1; layer < 4; ++layer) {
    viewer->key("l");
    viewer->wait_for_rest();
    a_moment();
    seen.push_back(picture());
    for (size_t other = 0; other + 1 < seen.size(); ++other) EXPECT_GT(changed(seen[other], seen.back()), 0.01) << layer << " looks like " << other;
  }
  viewer->key("shift+l shift+l shift+l");
  viewer->wait_for_rest();
  a_moment();
  EXPECT_EQ(changed(color, picture()), 0);
  ends_well(*viewer);
}

// Twenty sizes, and a swapchain for each; the last is as large as the first.
TEST_F(WindowTest, IsResizedTwentyTimes) {
  const auto viewer = opened();
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat before = picture();
  const int width = 700, height = 420;
  for (int i = 1; i <= 20; ++i) {
    const int w = i == 20 ? width : 420 + 23 * i, h = i == 20 ? height : 640 - 19 * i;
    desktop_->hands(fmt::format("search --name '^arah' windowsize {} {}", w, h));
    viewer->wait_for("picture");
  }
  viewer->wait_for_rest();
  a_moment();
  EXPECT_EQ(changed(before, picture()), 0);
  ends_well(*viewer);
  EXPECT_GE(viewer->events().back().at("swapchains").get<int>(), 10);
}

// Gone from the screen and back: what a window manager does to a minimised window.
TEST_F(WindowTest, ComesBackFromBeingHidden) {
  const auto viewer = opened();
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat before = picture();
  desktop_->hands("search --name '^arah' windowunmap sleep 1 windowmap sleep 1 windowfocus");
  viewer->key("t");
  for (int i = 0; i < 3; ++i) viewer->wait_for("picture");
  viewer->key("t");
  viewer->key("f");
  viewer->wait_for_rest();
  a_moment();
  EXPECT_EQ(changed(before, picture()), 0);
  ends_well(*viewer);
}

// Training opens it with the first checkpoint, and does not end with it.
TEST_F(WindowTest, TrainingOpensIt) {
  const fs::path capture = own_ / "capture", run = own_ / "run";
  ASSERT_EQ(std::system(fmt::format("{} synth {} --size 64 --frames 3 >{} 2>&1", ARAH_CLI, capture.string(), (own_ / "synth.txt").string()).c_str()), 0) << read_all(own_ / "synth.txt");
  const std::string train = fmt::format("DISPLAY={} {} train {} -o {} --steps 4 --view --set fit_steps=30 --set fit_skinning_steps=30 >{} 2>&1", desktop_->display(), ARAH_CLI, capture.string(), run.string(), (own_ / "train.txt").string());
  ASSERT_EQ(std::system(train.c_str()), 0) << read_all(own_ / "train.txt");
  // The training has ended; the window is there, or on its way.
  desktop_->hands("search --sync --onlyvisible --name '^arah run'");
  desktop_->hands("search --name '^arah run' windowfocus key ctrl+q");
  for (int tries = 0; tries < 600; ++tries) {
    if (std::system(fmt::format("DISPLAY={} xdotool search --name '^arah run' >/dev/null 2>&1", desktop_->display()).c_str()) != 0) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  FAIL() << "the window does not close";
}

// The file of the finest picture is the one that `arah render` writes, byte for byte.
TEST_F(WindowTest, ItsPaperPictureIsTheOneOfArahRender) {
  const fs::path capture = own_ / "capture";
  ASSERT_EQ(std::system(fmt::format("{} synth {} --size 96 --frames 3 >{} 2>&1", ARAH_CLI, capture.string(), (own_ / "synth.txt").string()).c_str()), 0) << read_all(own_ / "synth.txt");
  const Capture opened_capture = open_capture(capture);
  AvatarSpec spec = small_paper_spec();
  Avatar avatar = make_avatar(spec, opened_capture, 3);
  TrainingSettings settings;
  settings.fit_steps = 200;
  settings.fit_skinning_steps = 150;
  fit_template(test_device(), avatar, settings);
  const fs::path file = own_ / "person.safetensors";
  save_avatar(file, avatar);
  const std::string camera = opened_capture.cameras[1].name;
  const int frame = opened_capture.motions.at("train").frames[0].number;

  ::setenv("XDG_STATE_HOME", (own_ / "states").c_str(), 1);
  ViewerOnDesktop viewer(*desktop_, {file.string(), "--capture", capture.string(), "--out", (own_ / "out").string(), "--width", "700", "--height", "420", "--quality", "paper"}, own_);
  viewer.wait_for_rest();
  viewer.key("c");
  viewer.wait_for_rest();
  viewer.key("c");
  viewer.wait_for_rest();
  viewer.key("s");
  const Event shot = viewer.wait_for("screenshot");
  EXPECT_EQ(shot.at("quality"), "paper");
  EXPECT_EQ(shot.at("part"), 1.0);
  ends_well(viewer);

  const fs::path rendered = own_ / "rendered.png";
  ASSERT_EQ(std::system(fmt::format("{} render {} -o {} --capture {} --camera {} --frame {} >{} 2>&1", ARAH_CLI, file.string(), rendered.string(), capture.string(), camera, frame, (own_ / "render.txt").string()).c_str()), 0) << read_all(own_ / "render.txt");
  EXPECT_TRUE(read_all(shot.at("file").get<std::string>()) == read_all(rendered)) << "the two pictures differ";
  EXPECT_GT(cv::countNonZero(cv::imread(rendered.string(), cv::IMREAD_GRAYSCALE)), 200);
}

TEST_F(WindowTest, KeepsScreenshotsVideosMeshesAndItsState) {
  const fs::path state = own_ / "view.json";
  cv::Mat before;
  {
    const auto viewer = opened({"--state", state.string()});
    viewer->wait_for_rest();
    viewer->drag(500, 200, 560, 190);
    viewer->wait_for_rest();
    a_moment();
    before = picture();
    viewer->key("s");
    EXPECT_TRUE(fs::exists(viewer->wait_for("screenshot").at("file").get<std::string>()));
    viewer->key("p");
    EXPECT_THAT(viewer->wait_for("job").at("outcome").get<std::string>(), testing::HasSubstr("mesh_0001.ply"));
    viewer->wait_for_rest();
    viewer->key("ctrl+s");
    viewer->wait_for("state");
    viewer->key("m space");
    std::this_thread::sleep_for(std::chrono::milliseconds(900));
    viewer->key("m");
    EXPECT_THAT(viewer->wait_for("job").at("outcome").get<std::string>(), testing::HasSubstr("video_0001.mp4"));
    ends_well(*viewer);
  }
  cv::VideoCapture video((own_ / "out" / "video_0001.mp4").string());
  ASSERT_TRUE(video.isOpened());
  EXPECT_EQ(video.get(cv::CAP_PROP_FPS), 25);
  EXPECT_GE(video.get(cv::CAP_PROP_FRAME_COUNT), 5);
  EXPECT_FALSE(read_view_state(state).timeline.playing);
  const auto viewer = opened({"--state", state.string()});
  viewer->wait_for_rest();
  a_moment();
  EXPECT_EQ(changed(before, picture()), 0) << "the saved view is not the one that was seen";
  ends_well(*viewer);
}

TEST_F(WindowTest, FollowsCheckpoints) {
  const auto viewer = opened();
  viewer->wait_for_rest();
  a_moment();
  const cv::Mat before = picture();
  Avatar avatar = load_avatar(folder() / "capsule.safetensors");
  const Avatar kept = avatar;
  avatar.steps = 1234;
  for (const TensorSlot& slot : avatar.layout.slots)
    if (slot.name.starts_with("color."))
      for (float& number : avatar.tensor(slot.name)) number *= -2;
  save_avatar(folder() / "capsule.safetensors", avatar);
  EXPECT_EQ(viewer->wait_for("checkpoint").at("steps"), 1234);
  viewer->wait_for("a picture of it", [](const Event& e) { return e.at("event") == "picture" && e.at("steps") == 1234 && e.at("finest") == true; });
  a_moment();
  EXPECT_GT(changed(before, picture()), 0.01);
  save_avatar(folder() / "capsule.safetensors", kept);
  ends_well(*viewer);
}

// No frame keeps memory: 1,000 of them while the person turns, and the resident set after the first hundreds and at the end.
TEST_F(WindowTest, AThousandFramesLeakNothing) {
  const auto viewer = opened();
  viewer->wait_for_rest();
  viewer->key("t");
  const auto pages = [&] {
    std::ifstream file(fmt::format("/proc/{}/statm", viewer->program().id()));
    long all = 0, resident = 0;
    file >> all >> resident;
    return resident;
  };
  const auto frames = [&](int count) {
    for (int i = 0; i < count; ++i) viewer->wait_for("picture");
  };
  frames(100);
  const long before = pages();
  frames(1000);
  const double grown = static_cast<double>(pages() - before) * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1e6;
  std::printf("  resident set: %+.1f MB over 1,000 pictures\n", grown);
  EXPECT_LT(grown, 12) << "MB";  // 12 kB a frame would be a leak; malloc's own rooms come and go
  viewer->key("t");
  ends_well(*viewer);
}

TEST_F(WindowTest, MeasuresItself) {
  const auto viewer = opened({"--measure", "4s"});
  const Outcome outcome = viewer->program().wait();
  EXPECT_EQ(outcome.code, 0) << outcome.errors;
  EXPECT_THAT(outcome.output, testing::HasSubstr("input to picture on the screen, turning"));
  EXPECT_THAT(outcome.output, testing::HasSubstr("input to picture on the screen, playing"));
  EXPECT_THAT(outcome.output, testing::HasSubstr("rest to the finest picture"));
  std::fputs(outcome.output.substr(outcome.output.find("milliseconds"), 2000).c_str(), stdout);
}

TEST(WindowlessTest, WithoutADisplayItGivesAdvice) {
  const fs::path own = fs::temp_directory_path() / fmt::format("arah_windowless_{}", ::getpid());
  fs::create_directories(own);
  save_avatar(own / "any.safetensors", make_avatar(small_paper_spec(), capsule_body(), {0, 7}, 5));
  const auto outcome = [&](const std::vector<std::string>& words) {
    return Program(words, own, [] {
             ::unsetenv("DISPLAY");
             ::unsetenv("WAYLAND_DISPLAY");
           }).wait();
  };
  const Outcome none = outcome({(own / "any.safetensors").string()});
  EXPECT_EQ(none.code, 1);
  EXPECT_THAT(none.errors, testing::AllOf(testing::HasSubstr("no window"), testing::HasSubstr("arah render")));
  EXPECT_EQ(outcome({(own / "no_such").string()}).code, 2);
  EXPECT_EQ(outcome({"--help"}).code, 0);
  std::error_code error;
  fs::remove_all(own, error);
}

}  // namespace
}  // namespace arah
