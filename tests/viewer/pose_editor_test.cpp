#include "viewer/pose_editor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <numbers>
#include <random>

#include "tests/viewer/small_person.h"

namespace arah {
namespace {

constexpr double kPi = std::numbers::pi;

double angle_between(const glm::dvec3& a, const glm::dvec3& b) {
  return glm::length(axis_angle_from_rotation(glm::transpose(rotation_from_axis_angle(a)) * rotation_from_axis_angle(b)));
}

Pose random_pose(const Skeleton& skeleton, unsigned seed, double most) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> any(-most, most);
  Pose pose{std::vector<glm::dvec3>(skeleton.size()), {any(random), any(random), any(random)}};
  for (glm::dvec3& theta : pose.theta) theta = {any(random), any(random), any(random)};
  return pose;
}

TEST(PoseEditsTest, MakeThePoseThatWasWanted) {
  const Skeleton person = smpl_person();
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Pose base = random_pose(person, seed, 3);
    Pose wanted = random_pose(person, seed + 1000, 3);
    wanted.theta[5] = base.theta[5];
    const PoseEdits edits = edits_between(base, wanted);
    const Pose made = edited(base, edits);
    for (std::size_t j = 0; j < 24; ++j) EXPECT_NEAR(angle_between(made.theta[j], wanted.theta[j]), 0, 1e-7);
    EXPECT_NEAR(glm::length(made.root_position - wanted.root_position), 0, 1e-12);
    EXPECT_EQ(edits.turns[5], glm::dvec3(0.0));
    EXPECT_EQ(made.theta[5], base.theta[5]);
  }
}

TEST(PoseEditsTest, StayOnAPoseThatPlaysOn) {
  const Skeleton person = smpl_person();
  PoseEdits edits{std::vector<glm::dvec3>(24), {0, 0.1, 0}};
  edits.turns[joint_named(person, "left_elbow")] = {0, 0, 0.5};
  for (unsigned seed = 0; seed < 5; ++seed) {
    const Pose base = random_pose(person, seed, 2), pose = edited(base, edits);
    for (std::size_t j = 0; j < 24; ++j) {
      if (j == joint_named(person, "left_elbow")) {
        EXPECT_NEAR(angle_between(base.theta[j], pose.theta[j]), 0.5, 1e-9);
      } else {
        EXPECT_EQ(pose.theta[j], base.theta[j]);
      }
    }
    EXPECT_EQ(pose.root_position, base.root_position + glm::dvec3(0, 0.1, 0));
    EXPECT_EQ(edited(base, {}), base);
  }
  EXPECT_THROW(edited(Pose{{{0, 0, 0}}, {}}, edits), std::invalid_argument);
}

TEST(PoseEditsTest, AJointOrAllCanBeReset) {
  PoseEdits edits{{{1, 0, 0}, {0, 1, 0}}, {0, 0, 1}};
  EXPECT_EQ(without_edit(edits, 1), (PoseEdits{{{1, 0, 0}, {0, 0, 0}}, {0, 0, 1}}));
  EXPECT_EQ(without_edit(edits, 0), (PoseEdits{{{0, 0, 0}, {0, 1, 0}}, {0, 0, 0}}));
  EXPECT_EQ(without_edit(without_edit(edits, 0), 1), PoseEdits{});
  EXPECT_EQ(without_edit({}, 3), PoseEdits{});
  EXPECT_THROW(without_edit(edits, 2), std::out_of_range);
}

TEST(PoseEditsTest, SlidersShowEveryRotation) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(-kPi, kPi);
  for (int i = 0; i < 2000; ++i) {
    glm::dvec3 rotation(any(random), any(random), any(random));
    if (i % 4 == 0) rotation = axis_angle_of_sliders({any(random), (i % 8 == 0 ? 0.5 : -0.5) * kPi, any(random)});  // x and z turn alike
    const glm::dvec3 angles = slider_angles(rotation);
    ASSERT_NEAR(angle_between(axis_angle_of_sliders(angles), rotation), 0, 1e-7);
    ASSERT_LE(std::abs(angles.y), 0.5 * kPi + 1e-12);
  }
  const glm::dvec3 alone = slider_angles({0, 0, 0.3});
  EXPECT_NEAR(glm::length(alone - glm::dvec3(0, 0, 0.3)), 0, 1e-12);
  const glm::dvec3 given(0.4, -0.9, 2.5), shown = slider_angles(axis_angle_of_sliders(given));
  EXPECT_NEAR(glm::length(shown - given), 0, 1e-12);
}

TEST(MirrorTest, KnowsTheOtherSideByName) {
  const Skeleton person = smpl_person();
  const std::vector<int> other = other_side(person);
  EXPECT_EQ(other[joint_named(person, "left_wrist")], find_joint(person, "right_wrist"));
  EXPECT_EQ(other[joint_named(person, "right_foot")], find_joint(person, "left_foot"));
  EXPECT_EQ(other[joint_named(person, "spine2")], find_joint(person, "spine2"));
  const Skeleton rig{{"Hips", "mixamorig:LeftArm", "mixamorig:RightArm", "thigh.L", "thigh.R", "tail_l", "curl"}, {-1, 0, 0, 0, 0, 0, 0}, std::vector<glm::dvec3>(7)};
  EXPECT_THAT(other_side(rig), testing::ElementsAre(0, 2, 1, 4, 3, 5, 6));  // no tail_r, and curl ends in no side
}

TEST(MirrorTest, ALimbCopiedAcrossIsItsMirrorImage) {
  const Skeleton person = smpl_person();
  Pose pose = random_pose(person, 3, 0.8);
  for (const char* middle : {"pelvis", "spine1", "spine2", "spine3"}) pose.theta[joint_named(person, middle)] = {0, 0, 0};
  pose.root_position = person.rest_joints[0];
  const Pose mirrored = copied_across(person, pose, find_joint(person, "left_collar"));
  const std::vector<glm::dvec3> places = posed_joints(person, mirrored);
  for (const char* name : {"shoulder", "elbow", "wrist", "hand"}) {
    const glm::dvec3 left = places[joint_named(person, std::string("left_") + name)], right = places[joint_named(person, std::string("right_") + name)];
    EXPECT_NEAR(glm::length(right - glm::dvec3(-left.x, left.y, left.z)), 0, 1e-12) << name;
  }
  for (const char* name : {"left_wrist", "left_hip", "right_knee", "head", "pelvis"}) EXPECT_EQ(mirrored.theta[joint_named(person, name)], pose.theta[joint_named(person, name)]);
  EXPECT_EQ(copied_across(person, pose, find_joint(person, "head")), pose);
  EXPECT_THROW(copied_across(person, pose, 24), std::out_of_range);
}

TEST(EditHistoryTest, UndoesAndRedoes) {
  const auto shifted = [](double x) { return PoseEdits{{}, {x, 0, 0}}; };
  EditHistory history;
  EXPECT_FALSE(history.can_undo());
  EXPECT_FALSE(history.can_redo());
  history.undo(), history.redo();
  EXPECT_EQ(history.shown(), PoseEdits{});
  history.change(shifted(1));
  for (double x = 1; x < 2; x += 0.1) history.show(shifted(x));  // a hand drags
  history.show(shifted(2)), history.keep(), history.keep();
  history.change(shifted(3));
  history.undo();
  EXPECT_EQ(history.shown(), shifted(2));
  history.undo();
  EXPECT_EQ(history.shown(), shifted(1));
  EXPECT_TRUE(history.can_redo());
  history.redo();
  EXPECT_EQ(history.shown(), shifted(2));
  history.change(shifted(5));  // what was undone is gone
  EXPECT_FALSE(history.can_redo());
  history.show(shifted(6));  // not kept: undone by itself
  EXPECT_FALSE(history.can_redo());
  history.undo();
  EXPECT_EQ(history.shown(), shifted(5));
  history.undo(), history.undo(), history.undo();
  EXPECT_EQ(history.shown(), PoseEdits{});
  EXPECT_FALSE(history.can_undo());
}

TEST(EditHistoryTest, ForgetsTheOldest) {
  EditHistory history;
  for (int i = 1; i <= 1000; ++i) history.change({{}, {i, 0, 0}});
  int undone = 0;
  for (; history.can_undo(); ++undone) history.undo();
  EXPECT_EQ(undone, static_cast<int>(EditHistory::kMost) - 1);
  EXPECT_EQ(history.shown().shift.x, 1000 - undone);
}

TEST(PickingTest, TakesTheJointUnderTheCursor) {
  const Skeleton person = smpl_person();
  const Camera camera = camera_in_front();
  const std::vector<glm::dvec3> joints = posed_joints(person, rest_pose(person));
  for (std::size_t j = 0; j < joints.size(); ++j) EXPECT_EQ(joint_under(camera, joints, camera.project(joints[j]) + glm::dvec2(1, -1)), static_cast<int>(j)) << person.names[j];
  EXPECT_EQ(joint_under(camera, joints, {2, 2}), std::nullopt);
  const glm::dvec2 head = camera.project(joints[joint_named(person, "head")]);
  EXPECT_EQ(joint_under(camera, joints, head - glm::dvec2(0, 20), 12), std::nullopt);
  EXPECT_EQ(joint_under(camera, joints, head - glm::dvec2(0, 20), 21), find_joint(person, "head"));
}

TEST(PickingTest, WhatIsBehindTheCameraIsNotThere) {
  const Camera camera = camera_in_front();
  const glm::dvec3 forward(camera.R[0][2], camera.R[1][2], camera.R[2][2]);
  const std::vector<glm::dvec3> joints{camera.center() - forward, camera.center() + 2.0 * forward, camera.center() + forward, camera.center(), camera.center() + 0.005 * forward};
  EXPECT_EQ(joint_under(camera, joints, camera.project(joints[1])), 2);  // of two on one line of sight the near one
  EXPECT_THROW(taken(camera, joints, 0, {0, 0}), std::invalid_argument);
  EXPECT_THROW(taken(camera, joints, 4, {0, 0}), std::invalid_argument);
  EXPECT_THROW(taken(camera, joints, 5, {0, 0}), std::invalid_argument);
  EXPECT_EQ(joint_under(camera, {}, {0, 0}), std::nullopt);
}

TEST(DraggingTest, AHeldJointFollowsTheCursor) {
  const Skeleton person = smpl_person();
  const Camera camera = camera_in_front();
  const Pose rest = rest_pose(person);
  const std::vector<glm::dvec3> joints = posed_joints(person, rest);
  const int wrist = find_joint(person, "left_wrist");
  const glm::dvec2 at = camera.project(joints[static_cast<std::size_t>(wrist)]), cursor = at + glm::dvec2(3, 2);
  const HeldJoint held = taken(camera, joints, wrist, cursor);
  EXPECT_NEAR(glm::length(wanted_place(camera, held, cursor) - joints[static_cast<std::size_t>(wrist)]), 0, 1e-12);  // no jump
  for (const glm::dvec2 way : {glm::dvec2(0, -40), glm::dvec2(-30, -10), glm::dvec2(-25, 5)}) {
    const std::vector<glm::dvec3> after = posed_joints(person, pulled(camera, person, rest, held, cursor + way));
    const glm::dvec3 place = after[static_cast<std::size_t>(wrist)];
    EXPECT_NEAR(glm::length(camera.project(place) - (at + way)), 0, 1e-6);
    EXPECT_NEAR(camera.to_camera(place).z, held.depth, 1e-6);
    EXPECT_EQ(after[joint_named(person, "right_wrist")], joints[joint_named(person, "right_wrist")]);
  }
  // The root takes the person along.
  const HeldJoint root = taken(camera, joints, 0, camera.project(joints[0]));
  const Pose moved = pulled(camera, person, rest, root, camera.project(joints[0]) + glm::dvec2(50, 0));
  EXPECT_EQ(moved.theta, rest.theta);
  EXPECT_NEAR(camera.project(moved.root_position).x, camera.project(joints[0]).x + 50, 1e-9);
  // Edits hold what a drag did.
  const Pose pose = pulled(camera, person, rest, held, cursor + glm::dvec2(-20, -30));
  const std::vector<glm::dvec3> wanted = posed_joints(person, pose), made = posed_joints(person, edited(rest, edits_between(rest, pose)));
  for (std::size_t j = 0; j < wanted.size(); ++j) EXPECT_NEAR(glm::length(wanted[j] - made[j]), 0, 1e-12);
}

}  // namespace
}  // namespace arah
