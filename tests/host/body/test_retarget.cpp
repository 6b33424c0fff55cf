// Motions of other files and skeletons, on rigs of this project.
#include <fmt/format.h>

#include <glm/geometric.hpp>
#include <glm/gtc/constants.hpp>
#include <glm/matrix.hpp>
#include <random>

#include "host/body/bvh.h"
#include "host/body/motion_file.h"
#include "host/body/smpl_joints.h"
#include "tests/host/body/python_files.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using Vec = glm::dvec3;

// SMPL's tree with limbs of given directions: arms hang by `down`, legs stand apart by `apart`, radians.
Skeleton person(double down, double apart, double size = 1.0) {
  Skeleton skeleton;
  skeleton.names = smpl_joint_names(24, "");
  skeleton.parents = smpl_joint_parents(24, "");
  skeleton.rest_joints.resize(24);
  const auto put = [&](const std::string& name, const Vec& from_parent) {
    const auto j = static_cast<std::size_t>(find_joint(skeleton, name));
    skeleton.rest_joints[j] = (j == 0 ? Vec(0.0) : skeleton.rest_joints[static_cast<std::size_t>(skeleton.parents[j])]) + size * from_parent;
  };
  put("pelvis", {0, 0.95, 0.01});
  put("spine1", {0, 0.11, -0.02});
  put("spine2", {0, 0.13, 0.01});
  put("spine3", {0, 0.06, 0.01});
  put("neck", {0, 0.21, -0.03});
  put("head", {0, 0.09, 0.05});
  for (const double s : {1.0, -1.0}) {
    const std::string side = s > 0 ? "left_" : "right_";
    const Vec arm(s * std::cos(down), -std::sin(down), 0), leg(s * std::sin(apart), -std::cos(apart), 0);
    put(side + "hip", {0.07 * s, -0.09, 0});
    put(side + "knee", 0.38 * leg);
    put(side + "ankle", 0.4 * leg);
    put(side + "foot", {0.02 * s, -0.06, 0.12});
    put(side + "collar", {0.08 * s, 0.12, 0});
    put(side + "shoulder", {0.09 * s, 0.03, 0});
    put(side + "elbow", 0.26 * arm);
    put(side + "wrist", 0.25 * arm);
    put(side + "hand", 0.08 * arm);
  }
  return skeleton;
}

Motion random_motion(const Skeleton& skeleton, int frames, double most) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> any(-most, most);
  Motion motion;
  motion.skeleton = skeleton;
  motion.frames_per_second = 30;
  for (int f = 0; f < frames; ++f) {
    MotionFrame frame{f, rest_pose(skeleton), ""};
    for (Vec& theta : frame.pose.theta) theta = {any(random), any(random), any(random)};
    frame.pose.theta[0] = axis_angle_from_rotation(rotation_from_axis_angle({glm::half_pi<double>(), 0, 0}) * rotation_from_axis_angle(frame.pose.theta[0]));
    frame.pose.root_position = {any(random), any(random), 0.9};
    motion.frames.push_back(frame);
  }
  return motion;
}

std::vector<Vec> joints_of(const Skeleton& skeleton, const Pose& pose) {
  std::vector<Vec> places;
  for (const glm::dmat4& joint : forward_kinematics(skeleton, pose)) places.push_back(Vec(joint[3]) + root_translation(skeleton, pose));
  return places;
}

double largest_distance(const std::vector<Vec>& a, const std::vector<Vec>& b) {
  double largest = 0;
  for (std::size_t j = 0; j < a.size(); ++j) largest = std::max(largest, glm::distance(a[j], b[j]));
  return largest;
}

// The direction of a bone, by SMPL's names.
Vec bone(const Skeleton& skeleton, const std::vector<Vec>& places, const std::string& from, const std::string& to) {
  return glm::normalize(places[static_cast<std::size_t>(find_joint(skeleton, to))] - places[static_cast<std::size_t>(find_joint(skeleton, from))]);
}

// Writes a +Z-up motion as a BVH file of a +Y-up world in centimetres, angles Z, X, Y as programs write them.
std::string bvh_text(const Motion& motion, const std::vector<std::string>& names) {
  const Skeleton& skeleton = motion.skeleton;
  std::string text = "HIERARCHY\n";
  std::vector<std::size_t> order;
  const auto joint = [&](const auto& self, std::size_t j) -> void {
    order.push_back(j);
    const Vec offset = 100.0 * (j == 0 ? skeleton.rest_joints[0] : skeleton.rest_joints[j] - skeleton.rest_joints[static_cast<std::size_t>(skeleton.parents[j])]);
    text += fmt::format("{} {}\n{{\nOFFSET {} {} {}\nCHANNELS {}Zrotation Xrotation Yrotation\n", j == 0 ? "ROOT" : "JOINT", names[j], offset.x, offset.y, offset.z,
                        j == 0 ? "6 Xposition Yposition Zposition " : "3 ");
    bool leaf = true;
    for (std::size_t child = j + 1; child < skeleton.size(); ++child) {
      if (skeleton.parents[child] != static_cast<int>(j)) continue;
      leaf = false;
      self(self, child);
    }
    text += leaf ? "End Site\n{\nOFFSET 0 1 0\n}\n}\n" : "}\n";
  };
  joint(joint, 0);
  text += fmt::format("MOTION\nFrames: {}\nFrame Time: {}\n", motion.frames.size(), 1.0 / motion.frames_per_second);
  const glm::dmat3 lie = rotation_from_axis_angle({-glm::half_pi<double>(), 0, 0});
  for (const MotionFrame& frame : motion.frames) {
    const Vec at = 100.0 * (lie * frame.pose.root_position);
    text += fmt::format("{} {} {}", at.x, at.y, at.z);
    for (const std::size_t j : order) {
      const glm::dmat3 turn = rotation_from_axis_angle(frame.pose.theta[j]), r = j == 0 ? lie * turn : turn;
      // R = Rz Rx Ry: its second column is (−sin z cos x, cos z cos x, sin x), its third row (−cos x sin y, sin x, cos x cos y).
      const Vec angles = glm::degrees(Vec(std::atan2(-r[1][0], r[1][1]), std::asin(r[1][2]), std::atan2(-r[0][2], r[2][2])));
      text += fmt::format(" {} {} {}", angles.x, angles.y, angles.z);
    }
    text += "\n";
  }
  return text;
}

TEST(Retarget, BringsBackAMotionThatWasWrittenAsBvh) {
  const TemporaryFolder folder;
  const Skeleton skeleton = person(0.8, 0.1);
  const Motion motion = random_motion(skeleton, 20, 0.9);
  const std::filesystem::path path = folder.write("a.bvh", bvh_text(motion, skeleton.names));
  const MotionFile file = read_motion_file(path);
  EXPECT_EQ(file.motion.frames_per_second, 30.0);
  const Retargeted back = retarget(file.motion, skeleton, file.settings, "a.bvh");
  EXPECT_NEAR(back.scale, 0.01, 1e-9);
  ASSERT_EQ(back.motion.frames.size(), motion.frames.size());
  for (std::size_t f = 0; f < motion.frames.size(); ++f) {
    EXPECT_LT(largest_distance(joints_of(skeleton, back.motion.frames[f].pose), joints_of(skeleton, motion.frames[f].pose)), 1e-5);
  }
}

TEST(Retarget, KeepsDirectionsOfBonesBetweenTAndAPoses) {
  const Skeleton a_pose = person(0.8, 0.15), t_pose = person(0.0, 0.02, 1.7);
  for (const bool to_t : {true, false}) {
    const Skeleton &from = to_t ? a_pose : t_pose, &to = to_t ? t_pose : a_pose;
    const Motion motion = random_motion(from, 10, 0.9);
    const Retargeted result = retarget(motion, to, {}, "motion");
    EXPECT_FALSE(result.same_rest);
    EXPECT_NEAR(result.scale, to_t ? 1.7 : 1 / 1.7, 1e-12);
    for (std::size_t f = 0; f < motion.frames.size(); ++f) {
      const std::vector<Vec> theirs = joints_of(from, motion.frames[f].pose), own = joints_of(to, result.motion.frames[f].pose);
      for (const std::string side : {"left_", "right_"}) {
        for (const auto& [start, end] : std::vector<std::pair<std::string, std::string>>{{"hip", "knee"}, {"knee", "ankle"}, {"ankle", "foot"}, {"shoulder", "elbow"}, {"elbow", "wrist"}}) {
          EXPECT_LT(glm::distance(bone(from, theirs, side + start, side + end), bone(to, own, side + start, side + end)), 1e-9) << side << start;
        }
      }
      EXPECT_LT(glm::distance(bone(from, theirs, "neck", "head"), bone(to, own, "neck", "head")), 1e-9);
      const auto middle = [](const std::vector<Vec>& places) { return 0.5 * (places[1] + places[2]); };
      EXPECT_LT(glm::distance(result.scale * middle(theirs), middle(own)), 1e-9);
    }
  }
}

TEST(Retarget, RestsAnArmThatTheSourceHoldsLevel) {
  // A T-pose at rest is arms 45 degrees up from an A-pose at rest: known by hand.
  const Skeleton a_pose = person(glm::quarter_pi<double>(), 0), t_pose = person(0, 0);
  Motion still;
  still.skeleton = t_pose;
  still.frames.push_back({0, rest_pose(t_pose), ""});
  const Pose pose = retarget(still, a_pose, {}, "still").motion.frames[0].pose;
  EXPECT_LT(glm::distance(pose.theta[16], Vec(0, 0, glm::quarter_pi<double>())), 1e-9);
  EXPECT_LT(glm::distance(pose.theta[17], Vec(0, 0, -glm::quarter_pi<double>())), 1e-9);
  for (std::size_t j = 0; j < 16; ++j) EXPECT_LT(glm::length(pose.theta[j]), 1e-9) << j;
  for (std::size_t j = 18; j < 24; ++j) EXPECT_LT(glm::length(pose.theta[j]), 1e-9) << j;
}

TEST(Retarget, KnowsTheNamesOfOtherRigs) {
  const Skeleton own = person(0, 0);
  const auto named = [&](const std::vector<std::string>& names) {
    Skeleton other = own;
    other.names = names;
    std::string all;
    for (const int joint : retarget(random_motion(other, 1, 0.5), own, {}, "motion").sources) all += fmt::format("{} ", joint);
    return all;
  };
  // In SMPL's order: pelvis, hips, spine1, knees, spine2, ankles, spine3, feet, neck, collars, head, shoulders, elbows, wrists, hands.
  const std::string all = "0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 ", but_hands = all.substr(0, all.size() - 6) + "-1 -1 ";
  EXPECT_EQ(named(own.names), all);
  std::vector<std::string> mixamo{"Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg", "Spine1", "LeftFoot", "RightFoot", "Spine2", "LeftToeBase", "RightToeBase",
                                  "Neck", "LeftShoulder", "RightShoulder", "Head", "LeftArm", "RightArm", "LeftForeArm", "RightForeArm", "LeftHand", "RightHand", "LeftHandMiddle1", "RightHandMiddle1"};
  EXPECT_EQ(named(mixamo), but_hands);
  for (std::string& name : mixamo) name = "mixamorig:" + name;
  EXPECT_EQ(named(mixamo), but_hands);
  EXPECT_EQ(named({"Hips", "LeftHip", "RightHip", "Chest", "LeftKnee", "RightKnee", "Chest2", "LeftAnkle", "RightAnkle", "Chest3", "LeftToe", "RightToe", "Neck", "LeftCollar", "RightCollar",
                   "Head", "LeftShoulder", "RightShoulder", "LeftElbow", "RightElbow", "LeftWrist", "RightWrist", "x", "y"}),
            but_hands);
  EXPECT_EQ(named({"hip", "lThigh", "rThigh", "abdomen", "lShin", "rShin", "waist", "lFoot", "rFoot", "chest", "lToe", "rToe", "neck", "lCollar", "rCollar", "head", "lShldr", "rShldr", "lForeArm",
                   "rForeArm", "lHand", "rHand", "x", "y"}),
            but_hands);
  EXPECT_EQ(named({"pelvis", "thigh_l", "thigh_r", "spine_01", "calf_l", "calf_r", "spine_02", "foot_l", "foot_r", "spine_03", "ball_l", "ball_r", "neck_01", "clavicle_l", "clavicle_r", "head",
                   "upperarm_l", "upperarm_r", "lowerarm_l", "lowerarm_r", "hand_l", "hand_r", "x", "y"}),
            but_hands);
}

TEST(Retarget, PassesABentSpineOnWhateverItsJoints) {
  Skeleton one;  // a spine of one joint
  one.names = {"Hips", "Spine", "Neck", "Head", "LeftUpLeg", "LeftLeg", "LeftFoot", "RightUpLeg", "RightLeg", "RightFoot"};
  one.parents = {-1, 0, 1, 2, 0, 4, 5, 0, 7, 8};
  one.rest_joints = {{0, 1, 0}, {0, 1.1, 0}, {0, 1.5, 0}, {0, 1.6, 0}, {0.1, 0.9, 0}, {0.1, 0.5, 0}, {0.1, 0.1, 0}, {-0.1, 0.9, 0}, {-0.1, 0.5, 0}, {-0.1, 0.1, 0}};
  Motion motion;
  motion.skeleton = one;
  motion.frames.push_back({0, rest_pose(one), ""});
  motion.frames[0].pose.theta[1] = {0.5, 0, 0};
  const Skeleton own = person(0, 0);
  const Retargeted result = retarget(motion, own, {}, "motion");
  EXPECT_LT(glm::distance(result.motion.frames[0].pose.theta[3], Vec(0.5, 0, 0)), 1e-9);
  for (const std::size_t j : {6u, 9u, 12u, 15u, 16u}) EXPECT_LT(glm::length(result.motion.frames[0].pose.theta[j]), 1e-9) << j;
  EXPECT_THAT(retarget_table(result, one), testing::HasSubstr("at rest: left_foot"));
}

TEST(Retarget, TurnsASkeletonThatRestsAlongOtherAxes) {
  // The same person standing along +Z and facing −Y at rest, as programs with +Z up write it.
  const Skeleton own = person(0.3, 0.1);
  const Motion motion = random_motion(own, 5, 0.7);
  const glm::dmat3 stand = rotation_from_axis_angle({glm::half_pi<double>(), 0, 0});
  Motion turned = motion;
  for (Vec& joint : turned.skeleton.rest_joints) joint = stand * joint;
  for (MotionFrame& frame : turned.frames) {
    for (std::size_t j = 0; j < frame.pose.theta.size(); ++j) {  // R' = S R Sᵀ below the root, R Sᵀ at it
      const glm::dmat3 r = rotation_from_axis_angle(frame.pose.theta[j]) * glm::transpose(stand);
      frame.pose.theta[j] = axis_angle_from_rotation(j == 0 ? r : stand * r);
    }
  }
  const Retargeted result = retarget(turned, own, {}, "motion");
  for (std::size_t f = 0; f < 5; ++f) EXPECT_LT(largest_distance(joints_of(own, result.motion.frames[f].pose), joints_of(own, motion.frames[f].pose)), 1e-9);
}

TEST(Retarget, RefusesWhatItCannotName) {
  const Skeleton own = person(0, 0);
  expect_input_error([&] { retarget(random_motion(chain_skeleton(5), 1, 0.1), own, {}, "m.bvh"); }, {"m.bvh", "'pelvis'", "0 of 5", "'bone_0'"});
  Skeleton flat = own;
  flat.rest_joints.assign(24, Vec(0.0));
  expect_input_error([&] { retarget(random_motion(flat, 1, 0.1), own, {}, "m.bvh"); }, {"m.bvh", "scale", "legs"});
  RetargetSettings settings;
  settings.scale = 2;
  EXPECT_EQ(retarget(random_motion(flat, 1, 0.1), own, settings, "m.bvh").motion.frames.size(), 1u);
  // Rigs of other names are theirs alone.
  EXPECT_EQ(retarget(random_motion(chain_skeleton(5), 1, 0.1), chain_skeleton(5), settings, "m").sources, (std::vector<int>{0, 1, 2, 3, 4}));
}

// --- AMASS and AIST++

std::vector<double> numbers(std::size_t count, double scale) {
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i) values.push_back(scale * std::sin(1.0 + 0.7 * static_cast<double>(i)));
  return values;
}

TEST(MotionFile, ReadsAmass) {
  const TemporaryFolder folder;
  for (const std::size_t joints : {24u, 52u, 55u}) {
    const std::vector<double> poses = numbers(2 * 3 * joints, 0.5);
    const MotionFile file = read_motion_file(folder.write("a.npz", python::npz({{"poses", python::npy({2, 3 * joints}, poses)},
                                                                                 {"trans", python::npy({2, 3}, {1, 2, 1.1, 3, 4, 1.2})},
                                                                                 {joints == 55 ? "mocap_frame_rate" : "mocap_framerate", python::npy({}, {120})}})));
    EXPECT_EQ(file.motion.frames_per_second, 120);
    ASSERT_EQ(file.motion.frames.size(), 2u);
    const Pose& pose = file.motion.frames[1].pose;
    EXPECT_EQ(file.motion.skeleton.size(), 22u);
    EXPECT_EQ(pose.theta[21], Vec(poses[3 * joints + 63], poses[3 * joints + 64], poses[3 * joints + 65]));
    EXPECT_LT(glm::distance(pose.root_position, Vec(3, 4, 1.2) + file.motion.skeleton.rest_joints[0]), 1e-12);
    // A rig that rests as SMPL does takes the rotations as they are; hands rest.
    const Skeleton rig = person(0.05, 0.08);
    const Retargeted result = retarget(file.motion, rig, file.settings, "a.npz");
    EXPECT_TRUE(result.same_rest);
    for (std::size_t j = 0; j < 22; ++j) {
      EXPECT_LT(glm::distance(rotation_from_axis_angle(result.motion.frames[1].pose.theta[j])[0], rotation_from_axis_angle(pose.theta[j])[0]), 1e-9);
    }
    EXPECT_LT(glm::length(result.motion.frames[1].pose.theta[22]), 1e-9);
    EXPECT_FALSE(retarget(file.motion, person(0.8, 0.08), file.settings, "a.npz").same_rest);
  }
}

TEST(MotionFile, ReadsAist) {
  const TemporaryFolder folder;
  std::vector<double> poses(72, 0.0);
  poses[3] = 0.25;
  const MotionFile file = read_motion_file(folder.write("a.pkl", python::pickle(python::dictionary({{"smpl_poses", python::array({1, 72}, poses)},
                                                                                                   {"smpl_trans", python::array({1, 3}, {10, 180, 30})},
                                                                                                   {"smpl_scaling", python::array({1}, {90})}}))));
  EXPECT_EQ(file.motion.frames_per_second, 60);
  const Pose& pose = file.motion.frames.at(0).pose;
  const Vec rest = file.motion.skeleton.rest_joints[0];
  EXPECT_LT(glm::distance(pose.root_position, Vec(1.0 / 9 + rest.x, -1.0 / 3 - rest.z, 2 + rest.y)), 1e-12);  // (x, y, z) → (x, −z, y)
  EXPECT_LT(glm::distance(pose.theta[0], Vec(glm::half_pi<double>(), 0, 0)), 1e-12);
  EXPECT_EQ(pose.theta[1], Vec(0.25, 0, 0));
}

TEST(MotionFile, RefusesWhatIsNoMotion) {
  const TemporaryFolder folder;
  const auto amass = [&](std::size_t frames, std::size_t width, double value, std::size_t trans, double rate) {
    return folder.write("bad.npz", python::npz({{"poses", python::npy({frames, width}, std::vector<double>(frames * width, value))},
                                                {"trans", python::npy({trans, 3}, std::vector<double>(3 * trans, 0.0))},
                                                {"mocap_framerate", python::npy({}, {rate})}}));
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  expect_input_error([&] { read_motion_file(amass(2, 156, nan, 2, 60)); }, {"bad.npz", "poses frame 0", "finite", "nan"});
  expect_input_error([&] { read_motion_file(amass(2, 156, 1e7, 2, 60)); }, {"bad.npz", "poses frame 0", "1e6"});
  expect_input_error([&] { read_motion_file(amass(2, 156, 0, 3, 60)); }, {"bad.npz", "trans", "2 frames", "found 3"});
  expect_input_error([&] { read_motion_file(amass(0, 156, 0, 0, 60)); }, {"bad.npz", "poses", "at least one frame"});
  expect_input_error([&] { read_motion_file(amass(2, 150, 0, 2, 60)); }, {"bad.npz", "52 (SMPL-H)", "50"});
  expect_input_error([&] { read_motion_file(amass(2, 157, 0, 2, 60)); }, {"bad.npz", "three numbers a joint", "157"});
  expect_input_error([&] { read_motion_file(amass(2, 156, 0, 2, 0)); }, {"bad.npz", "mocap_framerate", "above 0"});
  expect_input_error([&] { read_motion_file(folder.write("bad.npz", python::npz({{"betas", python::npy({1}, {0})}}))); }, {"bad.npz", "poses and trans", "betas"});
  expect_input_error([&] { read_motion_file(folder.write("bad.npz", "")); }, {"bad.npz"});
  expect_input_error([&] { read_motion_file(folder.write("bad.pkl", python::pickle(python::dictionary({{"smpl_trans", python::array({1, 3}, {0, 0, 0})}})))); }, {"bad.pkl", "smpl_poses"});
  const auto aist = [&](double scaling) {
    return folder.write("bad.pkl", python::pickle(python::dictionary({{"smpl_poses", python::array({1, 72}, std::vector<double>(72, 0.0))},
                                                                      {"smpl_trans", python::array({1, 3}, {0, 0, 0})},
                                                                      {"smpl_scaling", python::array({1}, {scaling})}})));
  };
  expect_input_error([&] { read_motion_file(aist(0)); }, {"bad.pkl", "smpl_scaling", "above 0"});
  expect_input_error([&] { read_motion_file(folder.write("a.fbx", "")); }, {"a.fbx", ".bvh", "'.fbx'"});
}

// --- Frames

TEST(MotionFrames, AreCutResampledLoopedAndPlaced) {
  Motion motion;
  motion.skeleton = chain_skeleton(2);
  motion.frames_per_second = 30;
  for (int f = 0; f < 7; ++f) motion.frames.push_back({f, {{Vec(0, 0, 0), Vec(0, 0, 0.4 * f)}, Vec(f, 2 * f, 0.9)}, ""});

  const Motion some = cut(motion, 1, 99, 2, "m");
  ASSERT_EQ(some.frames.size(), 3u);
  EXPECT_EQ(some.frames[2].pose, motion.frames[5].pose);
  EXPECT_EQ(some.frames[2].number, 2);
  EXPECT_EQ(some.frames_per_second, 15);
  expect_input_error([&] { cut(motion, 7, 9, 1, "m"); }, {"m", "frames", "of the 7"});

  const Motion more = resampled(motion, 50, "m");  // 0.2 s: 11 frames
  ASSERT_EQ(more.frames.size(), 11u);
  for (std::size_t f = 0; f < 11; ++f) {
    EXPECT_LT(glm::distance(more.frames[f].pose.root_position, Vec(0.6 * f, 1.2 * f, 0.9)), 1e-9);
    EXPECT_LT(glm::length(rotation_from_axis_angle(more.frames[f].pose.theta[1])[0] - Vec(std::cos(0.24 * f), std::sin(0.24 * f), 0)), 1e-9);
  }
  EXPECT_EQ(resampled(motion, 30, "m").frames.size(), 7u);
  EXPECT_EQ(resampled(motion, 10, "m").frames.size(), 3u);
  motion.frames_per_second = 0;
  expect_input_error([&] { resampled(motion, 30, "m"); }, {"m", "rate"});

  const Motion twice = looped(motion, 2, "m");
  ASSERT_EQ(twice.frames.size(), 14u);
  EXPECT_EQ(twice.frames[9].pose, motion.frames[2].pose);
  EXPECT_EQ(twice.frames[9].number, 9);
  expect_input_error([&] { looped(motion, 2'000'000, "m"); }, {"m", "at most"});

  const Motion there = placed(cut(motion, 2, 4, 1, "m"), {5, 6});
  EXPECT_EQ(there.frames[0].pose.root_position, Vec(5, 6, 0.9));
  EXPECT_EQ(there.frames[1].pose.root_position, Vec(6, 8, 0.9));
  EXPECT_EQ(placed(motion, {5, 6, 7}).frames[0].pose.root_position, Vec(5, 6, 7));
}

}  // namespace
}  // namespace arah
