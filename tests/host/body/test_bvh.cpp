#include <glm/gtc/constants.hpp>
#include <glm/matrix.hpp>

#include "host/body/bvh.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

// As capture programs write it: tabs, carriage returns, channels in an order of their own, an End Site.
const char* const kSmall =
    "HIERARCHY\r\n"
    "ROOT Hips\r\n"
    "{\r\n"
    "\tOFFSET 0.0 90.0 0.0\r\n"
    "\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\r\n"
    "\tJOINT Left Up Leg\r\n"
    "\t{\r\n"
    "\t\tOFFSET 10 -5 +0\r\n"
    "\t\tCHANNELS 3 Yrotation Zrotation Xrotation\r\n"
    "\t\tEnd Site\r\n"
    "\t\t{\r\n"
    "\t\t\tOFFSET 0 -40 0\r\n"
    "\t\t}\r\n"
    "\t}\r\n"
    "}\r\n"
    "MOTION\r\n"
    "Frames: 2\r\n"
    "Frame Time: 0.0333333\r\n"
    "1 95 3 0 0 0 0 0 0\r\n"
    "2 96 4 90 90 0 90 0 90\r\n";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, text.npos) << from;
  return text.replace(at, from.size(), to);
}

double difference(const glm::dmat3& a, const glm::dmat3& b) {
  double largest = 0;
  for (int c = 0; c < 3; ++c) largest = std::max(largest, glm::length(a[c] - b[c]));
  return largest;
}

TEST(Bvh, ReadsChannelsInTheirOrder) {
  const TemporaryFolder folder;
  const Motion motion = read_bvh(folder.write("small.bvh", kSmall), 0.01);
  EXPECT_THAT(motion.skeleton.names, testing::ElementsAre("Hips", "Left Up Leg"));
  EXPECT_THAT(motion.skeleton.parents, testing::ElementsAre(-1, 0));
  EXPECT_LT(glm::length(motion.skeleton.rest_joints[0] - glm::dvec3(0, 0.9, 0)), 1e-12);
  EXPECT_LT(glm::length(motion.skeleton.rest_joints[1] - glm::dvec3(0.1, 0.85, 0)), 1e-12);
  EXPECT_EQ(motion.frames_per_second, 30.0);
  ASSERT_EQ(motion.frames.size(), 2u);
  EXPECT_EQ(motion.frames[0].pose.theta[0], glm::dvec3(0.0));
  EXPECT_LT(glm::length(motion.frames[1].pose.root_position - glm::dvec3(0.02, 0.96, 0.04)), 1e-12);
  // Z first: R = Rz(90) Rx(90) takes x to y, y to z and z to x. The leg's Ry(90) Rx(90): x to −z, y to x, z to −y.
  EXPECT_LT(difference(rotation_from_axis_angle(motion.frames[1].pose.theta[0]), glm::dmat3(0, 1, 0, 0, 0, 1, 1, 0, 0)), 1e-12);
  EXPECT_LT(difference(rotation_from_axis_angle(motion.frames[1].pose.theta[1]), glm::dmat3(0, 0, -1, 1, 0, 0, 0, -1, 0)), 1e-12);
}

TEST(Bvh, TakesARootThatOnlyCarriesTheHipsIntoThem) {
  const TemporaryFolder folder;
  const Motion motion = read_bvh(folder.write("reference.bvh",
                                              "HIERARCHY\nROOT reference {\nOFFSET 1 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
                                              "JOINT Hips {\nOFFSET 0 2 0\nCHANNELS 4 Xposition Yposition Zposition Xrotation\n"
                                              "JOINT Spine {\nOFFSET 0 3 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{ OFFSET 0 1 0 }\n}\n}\n}\n"
                                              "MOTION\nFrames: 1\nFrame Time: 0.01\n10 0 0 90 0 0 5 6 7 90 0 0 0\n"));
  EXPECT_THAT(motion.skeleton.names, testing::ElementsAre("Hips", "Spine"));
  EXPECT_EQ(motion.skeleton.rest_joints[0], glm::dvec3(1, 2, 0));
  EXPECT_EQ(motion.skeleton.rest_joints[1], glm::dvec3(1, 5, 0));
  EXPECT_LT(glm::length(motion.frames[0].pose.root_position - glm::dvec3(10 - 6, 5, 7)), 1e-12);  // (10, 0, 0) + Rz(90) (5, 6, 7)
  EXPECT_LT(difference(rotation_from_axis_angle(motion.frames[0].pose.theta[0]), glm::dmat3(0, 1, 0, 0, 0, 1, 1, 0, 0)), 1e-12);
}

TEST(Bvh, NamesTheLineThatIsWrong) {
  const TemporaryFolder folder;
  const std::vector<std::pair<std::string, std::vector<std::string>>> cases = {
      {"", {"line 1", "'HIERARCHY'", "the end of the file"}},
      {replaced(kSmall, "ROOT", "ROOF"), {"line 2", "'ROOT'", "'ROOF'"}},
      {replaced(kSmall, "Hips", ""), {"line 2", "name"}},
      {replaced(kSmall, "Left Up Leg", "Hips"), {"line 6", "'Hips' twice"}},
      {replaced(kSmall, "90.0", "nan"), {"line 4", "OFFSET", "'nan'"}},
      {replaced(kSmall, "90.0", "1e300"), {"line 4", "OFFSET", "'1e300'"}},
      {replaced(kSmall, "90.0", "90,0"), {"line 4", "'90,0'"}},
      {replaced(kSmall, "CHANNELS 6", "CHANNELS 7"), {"line 5", "at most 6", "7"}},
      {replaced(kSmall, "CHANNELS 6", "CHANNELS -1"), {"line 5", "whole number", "'-1'"}},
      {replaced(kSmall, "CHANNELS 6", "CHANNELS 5"), {"line 5", "'JOINT', 'End Site' or '}'", "'Yrotation'"}},
      {replaced(kSmall, "Yposition", "Xposition"), {"line 5", "'Xposition' twice"}},
      {replaced(kSmall, "Yposition", "Wposition"), {"line 5", "Xposition", "'Wposition'"}},
      {replaced(kSmall, "Frames: 2", "Frames: 0"), {"line 17", "frames", "0"}},
      {replaced(kSmall, "Frames: 2", "Frames: 3"), {"3 frames of 9 numbers", "the end of the file in frame 2"}},
      {replaced(kSmall, "Frames: 2", "Frames: 1"), {"line 20", "the end after 1 frames"}},
      {replaced(kSmall, "0.0333333", "0"), {"line 18", "Frame Time"}},
      {replaced(kSmall, "0.0333333", "inf"), {"line 18", "Frame Time"}},
      {replaced(kSmall, "1 95 3 0 0 0 0 0 0", "1 95 3 0 0 0 0 0"), {"line 19", "9 numbers a line", "fewer"}},
      {replaced(kSmall, "1 95 3 0 0 0 0 0 0", "1 95 3 0 0 0 0 0 0 7"), {"line 19", "9 numbers a line", "'7'"}},
      {replaced(kSmall, "2 96 4", "2 inf 4"), {"line 20", "'inf'"}},
  };
  for (const auto& [text, parts] : cases) {
    SCOPED_TRACE(parts.back());
    const std::filesystem::path path = folder.write("bad.bvh", text);
    expect_input_error([&] { read_bvh(path); }, parts);
  }
  // Cut anywhere before its last number ends, it is an error, and none of another kind.
  const std::string whole = kSmall;
  for (std::size_t length = 0; length + 4 < whole.size(); ++length) {
    const std::filesystem::path path = folder.write("cut.bvh", whole.substr(0, length));
    expect_input_error([&] { read_bvh(path); }, {"cut.bvh: line "});
  }
}

TEST(Bvh, LimitsDepthAndNumberOfJoints) {
  const TemporaryFolder folder;
  std::string deep = "HIERARCHY\nROOT a {\nOFFSET 0 0 0\nCHANNELS 0\n", wide = deep;
  for (int i = 0; i < 300; ++i) {
    const std::string joint = "JOINT j" + std::to_string(i) + " {\nOFFSET 0 0 0\nCHANNELS 0\n";
    deep += joint;
    wide += joint + "}\n";
  }
  expect_input_error([&] { read_bvh(folder.write("deep.bvh", deep)); }, {"line", "nested at most 64 deep"});
  expect_input_error([&] { read_bvh(folder.write("wide.bvh", wide)); }, {"line", "at most 256 joints"});
  expect_input_error([&] { read_bvh(folder.write("still.bvh", "HIERARCHY\nROOT a {\nOFFSET 0 0 0\nCHANNELS 0\n}\nMOTION\nFrames: 99999999\nFrame Time: 1\n")); },
                     {"joints with channels", "none"});
}

}  // namespace
}  // namespace arah
