#include <functional>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "host/body/motion.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

Motion small_motion() {
  Motion motion;
  motion.split = "train";
  motion.skeleton = chain_skeleton(3);
  for (int number : {4, 7, 100000}) {
    Pose pose = rest_pose(motion.skeleton);
    pose.theta[1] = {0.1 * number, 1.0 / 3.0, -1e-17};
    pose.root_position = {1.0, number / 7.0, 0.0};
    motion.frames.push_back({number, pose, "made up"});
  }
  return motion;
}

TEST(Motion, ReadsBackWhatItWroteExactly) {
  const TemporaryFolder folder;
  const Motion motion = small_motion();
  write_motion(folder / "motion_train.json", motion);
  const Motion back = read_motion(folder / "motion_train.json");
  EXPECT_EQ(back.split, "train");
  EXPECT_EQ(back.skeleton.names, motion.skeleton.names);
  EXPECT_EQ(back.skeleton.rest_joints, motion.skeleton.rest_joints);
  ASSERT_EQ(back.frames.size(), 3u);
  for (std::size_t f = 0; f < 3; ++f) {
    EXPECT_EQ(back.frames[f].number, motion.frames[f].number);
    EXPECT_EQ(back.frames[f].pose.theta, motion.frames[f].pose.theta);
    EXPECT_EQ(back.frames[f].pose.root_position, motion.frames[f].pose.root_position);
    EXPECT_EQ(back.frames[f].source, "made up");
  }
  EXPECT_EQ(find_frame(back, 7)->pose.theta, motion.frames[1].pose.theta);
  EXPECT_EQ(find_frame(back, 8), nullptr);
}

TEST(Motion, NamesTheFrameAndTheFieldThatIsWrong) {
  const TemporaryFolder folder;
  write_motion(folder / "good.json", small_motion());
  std::ifstream file(folder / "good.json");
  const nlohmann::json good = nlohmann::json::parse(file);
  using nlohmann::json;
  const std::vector<std::pair<std::function<void(json*)>, std::vector<std::string>>> cases = {
      {[](json* m) { (*m)["frames"][1]["theta"][2][0] = nullptr; }, {"frame 7 theta[2] (bone_2)", "finite", "null"}},
      {[](json* m) { (*m)["frames"][1]["theta"][2][0] = "1.0"; }, {"frame 7 theta[2]", "finite number", "\"1.0\""}},
      {[](json* m) { (*m)["frames"][0]["theta"].erase(0); }, {"frame 4 theta", "3 values", "found 2"}},
      {[](json* m) {
         (*m)["frames"][0]["theta"][1] = {1, 2};
       },
       {"frame 4 theta[1]", "3 values", "found 2"}},
      {[](json* m) { (*m)["frames"][2]["frame"] = 4; }, {"frame 4", "twice"}},
      {[](json* m) { (*m)["frames"][2]["frame"] = -1; }, {"frames[2] frame", "integer", "-1"}},
      {[](json* m) { (*m)["frames"][2]["frame"] = 1.5; }, {"frames[2] frame", "integer", "1.5"}},
      {[](json* m) { (*m)["frames"][0].erase("root_position"), (*m)["frames"][0].erase("trans"); },
       {"root_position or trans"}},
      {[](json* m) { (*m)["frames"] = json::array(); }, {"at least one frame"}},
      {[](json* m) { (*m)["frames"] = 3; }, {"frames", "a list", "found 3"}},
      {[](json* m) { m->erase("joint_names"); }, {"joint_names", "none"}},
      {[](json* m) { (*m)["parents"][1] = 2; }, {"bone_1", "a parent that comes before it"}},
      {[](json* m) {
         (*m)["betas"] = {0, 0.5};
       },
       {"betas", "0.5"}},
      {[](json* m) { *m = json::array(); }, {"an object"}},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    json changed = good;
    cases[i].first(&changed);
    const std::filesystem::path path = folder.write("bad.json", changed.dump());
    std::vector<std::string> parts = cases[i].second;
    parts.push_back("bad.json");
    expect_input_error([&] { read_motion(path); }, parts);
  }
  const std::string text = good.dump();
  expect_input_error([&] { read_motion(folder / "none.json"); }, {"none.json"});
  expect_input_error([&] { read_motion(folder.write("cut.json", text.substr(0, text.size() / 2))); },
                     {"cut.json", "JSON"});
  std::string nan = text;
  nan.replace(nan.find("0.3333"), 6, "NaN");
  expect_input_error([&] { read_motion(folder.write("nan.json", nan)); }, {"nan.json", "line 1"});
}

TEST(Motion, TakesTheRootFromTheTranslation) {
  const TemporaryFolder folder;
  write_motion(folder / "motion.json", small_motion());
  std::ifstream file(folder / "motion.json");
  nlohmann::json text = nlohmann::json::parse(file);
  text["frames"][0].erase("root_position");
  const Motion motion = read_motion(folder.write("trans.json", text.dump()));
  EXPECT_LT(glm::length(motion.frames[0].pose.root_position - small_motion().frames[0].pose.root_position), 1e-15);
}

TEST(Motion, FitsATemplateByNames) {
  Motion motion = small_motion();
  Skeleton skeleton;  // the same chain with a side branch in between
  skeleton.names = {"bone_0", "finger", "bone_1", "bone_2"};
  skeleton.parents = {-1, 0, 0, 2};
  skeleton.rest_joints.resize(4, glm::dvec3(0.0));
  const Motion adapted = adapt_motion(motion, skeleton, "motion.json");
  EXPECT_EQ(adapted.frames[2].pose.theta[1], glm::dvec3(0.0));
  EXPECT_EQ(adapted.frames[2].pose.theta[2], motion.frames[2].pose.theta[1]);
  EXPECT_EQ(adapted.frames[2].pose.root_position, motion.frames[2].pose.root_position);

  motion.skeleton.names[2] = "tail";
  expect_input_error([&] { adapt_motion(motion, skeleton, "motion.json"); }, {"motion.json", "'tail'"});
  motion.skeleton.names[2] = "bone_2";
  skeleton.parents[3] = 1;
  expect_input_error([&] { adapt_motion(motion, skeleton, "motion.json"); }, {"'bone_2'", "'finger'", "'bone_1'"});
}

TEST(Motion, ReadsTheSubjectsMotions) {
  if (!std::filesystem::exists(subject_a())) GTEST_SKIP() << "no capture at " << subject_a();
  const Motion motion = read_motion(subject_a() / "motion_train.json");
  EXPECT_EQ(motion.frames.size(), 60u);
  // The file states the joints' world positions too.
  std::ifstream file(subject_a() / "motion_train.json");
  const nlohmann::json text = nlohmann::json::parse(file);
  double largest = 0.0;
  for (std::size_t f = 0; f < motion.frames.size(); ++f) {
    const Pose& pose = motion.frames[f].pose;
    const std::vector<glm::dmat4> frames = forward_kinematics(motion.skeleton, pose);
    for (std::size_t j = 0; j < frames.size(); ++j) {
      const glm::dvec3 joint = glm::dvec3(frames[j][3]) + root_translation(motion.skeleton, pose);
      for (std::size_t k = 0; k < 3; ++k) {
        const double stated = text["frames"][f]["joint_world"][j][4 * k + 3].get<double>();
        largest = std::max(largest, std::abs(joint[static_cast<int>(k)] - stated));
      }
    }
  }
  EXPECT_LT(largest, 3e-6);  // the file rounds angles and positions to 1e-6
}

}  // namespace
}  // namespace arah
