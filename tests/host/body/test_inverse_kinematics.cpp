// Joints that are dragged: where they end, what turns, and what does not.
#include "host/body/inverse_kinematics.h"

#include <fmt/format.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <numbers>
#include <random>

#include "host/body/motion.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

// A person's joints, arms and legs of several bones: pelvis, spine and chest; a head; arms that hang from collars; legs.
Skeleton small_person() {
  Skeleton skeleton;
  const auto add = [&](const std::string& name, const std::string& parent, glm::dvec3 place) {
    skeleton.parents.push_back(find_joint(skeleton, parent));
    skeleton.names.push_back(name);
    skeleton.rest_joints.push_back(place);
  };
  add("pelvis", "", {0, 0.95, 0});
  add("spine", "pelvis", {0, 1.1, -0.02});
  add("chest", "spine", {0, 1.3, 0});
  add("neck", "chest", {0, 1.5, -0.02});
  add("head", "neck", {0, 1.6, 0.02});
  for (const double s : {1.0, -1.0}) {
    const std::string side = s > 0 ? "left_" : "right_";
    add(side + "collar", "chest", {0.06 * s, 1.42, 0});
    add(side + "shoulder", side + "collar", {0.18 * s, 1.45, 0});
    add(side + "elbow", side + "shoulder", {0.36 * s, 1.25, -0.02});
    add(side + "wrist", side + "elbow", {0.52 * s, 1.08, 0.03});
    add(side + "hip", "pelvis", {0.08 * s, 0.87, 0});
    add(side + "knee", side + "hip", {0.1 * s, 0.48, 0.02});
    add(side + "ankle", side + "knee", {0.1 * s, 0.08, -0.02});
  }
  return skeleton;
}

std::size_t index_of(const Skeleton& skeleton, const std::string& name) { return static_cast<std::size_t>(find_joint(skeleton, name)); }

glm::dvec3 place_of(const Skeleton& skeleton, const Pose& pose, int joint) { return posed_joints(skeleton, pose)[static_cast<std::size_t>(joint)]; }

class Random {
 public:
  double within(double most) { return std::uniform_real_distribution<double>(-most, most)(engine_); }
  glm::dvec3 vector(double most) { return {within(most), within(most), within(most)}; }
  int joint(const Skeleton& skeleton) { return std::uniform_int_distribution<int>(0, static_cast<int>(skeleton.size()) - 1)(engine_); }
  Pose pose(const Skeleton& skeleton, double most) {
    Pose pose{std::vector<glm::dvec3>(skeleton.size()), vector(3)};
    for (glm::dvec3& theta : pose.theta) theta = vector(most);
    return pose;
  }

 private:
  std::mt19937_64 engine_{11};
};

// The largest angle between a joint's rotations in two poses, radians.
double largest_turn(const Pose& a, const Pose& b) {
  double largest = 0;
  for (std::size_t j = 0; j < a.theta.size(); ++j)
    largest = std::max(largest, glm::length(axis_angle_from_rotation(glm::transpose(rotation_from_axis_angle(a.theta[j])) * rotation_from_axis_angle(b.theta[j]))));
  return largest;
}

std::vector<std::string> names_of(const Skeleton& skeleton, const std::vector<int>& joints) {
  std::vector<std::string> names;
  for (const int j : joints) names.push_back(skeleton.names[static_cast<std::size_t>(j)]);
  return names;
}

TEST(InverseKinematicsTest, APulledLimbTurnsAndThePersonStays) {
  const Skeleton person = small_person();
  const auto turning = [&](const std::string& name, int most) { return names_of(person, turning_joints(person, find_joint(person, name), most)); };
  using testing::ElementsAre;
  EXPECT_THAT(turning("left_wrist", 2), ElementsAre("left_elbow", "left_shoulder"));
  EXPECT_THAT(turning("left_wrist", 9), ElementsAre("left_elbow", "left_shoulder", "left_collar"));
  EXPECT_THAT(turning("left_wrist", 1), ElementsAre("left_elbow"));
  EXPECT_THAT(turning("right_knee", 2), ElementsAre("right_hip"));
  EXPECT_THAT(turning("right_hip", 2), ElementsAre("pelvis"));
  EXPECT_THAT(turning("head", 2), ElementsAre("neck"));
  EXPECT_THAT(turning("neck", 2), ElementsAre("chest"));
  EXPECT_THAT(turning("chest", 2), ElementsAre("spine"));
  EXPECT_THAT(turning("pelvis", 2), ElementsAre());
  EXPECT_THROW(turning_joints(person, 99), std::out_of_range);
}

TEST(InverseKinematicsTest, TheJacobianIsThatOfFiniteDifferences) {
  const Skeleton person = small_person();
  Random random;
  double largest = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Pose pose = random.pose(person, 2);
    const int joint = random.joint(person);
    const std::vector<int> turning = turning_joints(person, joint, 4);
    const std::vector<glm::dmat3> jacobian = joint_jacobian(person, pose, joint, turning);
    constexpr double h = 1e-5;
    for (std::size_t i = 0; i < turning.size(); ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        glm::dvec3 turn(0.0);
        turn[axis] = h;
        const glm::dvec3 slope = (place_of(person, turned_in_world(person, pose, turning[i], turn), joint) - place_of(person, turned_in_world(person, pose, turning[i], -turn), joint)) / (2 * h);
        largest = std::max(largest, glm::length(slope - jacobian[i][axis]));
      }
    }
  }
  EXPECT_LT(largest, 1e-9);  // h² and rounding over h
}

TEST(InverseKinematicsTest, ReachesWhatCanBeReached) {
  const Skeleton person = small_person();
  Random random;
  double largest = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    const Pose pose = random.pose(person, 1.5);
    const int joint = 1 + random.joint(person) % (static_cast<int>(person.size()) - 1);
    // Where it is in another pose of the joints that may turn.
    Pose other = pose;
    for (const int j : turning_joints(person, joint, 3)) other.theta[static_cast<std::size_t>(j)] = random.vector(1.5);
    const glm::dvec3 target = place_of(person, other, joint);
    const double missed = glm::length(place_of(person, dragged(person, pose, joint, target, 3), joint) - target);
    largest = std::max(largest, missed);
    ASSERT_LT(missed, 1e-4) << person.names[static_cast<std::size_t>(joint)] << ", trial " << trial;
  }
  RecordProperty("largest_miss", fmt::format("{:.3g}", largest));
}

TEST(InverseKinematicsTest, PointsAtWhatIsOutOfReach) {
  const Skeleton person = small_person();
  Random random;
  const int wrist = find_joint(person, "left_wrist"), shoulder = find_joint(person, "left_shoulder"), elbow = find_joint(person, "left_elbow");
  double largest = 0;
  for (int trial = 0; trial < 500; ++trial) {
    const Pose pose = random.pose(person, 1.5);
    const glm::dvec3 from = place_of(person, pose, shoulder), towards = glm::normalize(random.vector(1) + glm::dvec3(0, 0, 1e-3));
    const Pose first = dragged(person, pose, wrist, from + std::pow(10.0, random.within(3) + 3) * towards);
    const double reach = glm::length(place_of(person, pose, elbow) - from) + glm::length(place_of(person, pose, wrist) - place_of(person, pose, elbow));
    const double missed = glm::length(place_of(person, first, wrist) - (from + reach * towards));
    largest = std::max(largest, missed);
    // Where it converged, pulling on changes nothing.
    const Pose again = dragged(person, first, wrist, from + 2.0 * towards);
    ASSERT_LT(missed, 1e-4) << trial;
    ASSERT_LT(largest_turn(first, again), 1e-2) << trial;
  }
  RecordProperty("largest_miss", fmt::format("{:.3g}", largest));
}

TEST(InverseKinematicsTest, AStraightArmBendsAndAFoldedOneOpens) {
  Skeleton arm = chain_skeleton(4);
  for (std::size_t j = 0; j < 4; ++j) arm.rest_joints[j] = {0.25 * static_cast<double>(j), 1, 0};
  const Pose rest = rest_pose(arm);
  // Pushed along itself, pulled to the very other side, into the joint that it hangs from; and from there out again.
  for (const glm::dvec3 target : {glm::dvec3(0.55, 1, 0), glm::dvec3(0.0, 1, 0), glm::dvec3(-0.1, 1, 0), glm::dvec3(0.25, 1, 0), glm::dvec3(0.25, 1.3, 0)}) {
    const Pose bent = dragged(arm, rest, 3, target);
    EXPECT_LT(glm::length(place_of(arm, bent, 3) - target), 1e-4) << target.x;
    const Pose opened = dragged(arm, bent, 3, {0.75, 1, 0});
    EXPECT_LT(glm::length(place_of(arm, opened, 3) - glm::dvec3(0.75, 1, 0)), 1e-4) << target.x;
  }
  // Longer below than above: what is nearer than their difference is as far as what is out of reach.
  arm.rest_joints[3].x = 1.0;
  const Pose folded = dragged(arm, rest_pose(arm), 3, {0.3, 1.05, 0});
  EXPECT_NEAR(glm::length(place_of(arm, folded, 3) - glm::dvec3(0.25, 1, 0)), 0.25, 1e-4);
  EXPECT_NEAR(glm::dot(glm::normalize(place_of(arm, folded, 3) - glm::dvec3(0.25, 1, 0)), glm::normalize(glm::dvec3(1, 1, 0))), 1, 1e-4);
}

TEST(InverseKinematicsTest, TenThousandDragsAreFiniteAndTouchNothingElse) {
  const Skeleton person = small_person();
  Random random;
  for (int trial = 0; trial < 10000; ++trial) {
    const Pose pose = random.pose(person, 4);
    const int joint = random.joint(person), most = 1 + trial % 4;
    const glm::dvec3 target = random.vector(1) * std::pow(10.0, random.within(8));
    const Pose result = dragged(person, pose, joint, target, most);
    const std::vector<int> turning = turning_joints(person, joint, most);
    for (int j = 0; j < static_cast<int>(person.size()); ++j) {
      const auto s = static_cast<std::size_t>(j);
      ASSERT_TRUE(std::isfinite(glm::length(result.theta[s])));
      const glm::dmat3 rotation = rotation_from_axis_angle(result.theta[s]);
      const glm::dmat3 gram = glm::transpose(rotation) * rotation - glm::dmat3(1.0);
      ASSERT_LT(glm::length(gram[0]) + glm::length(gram[1]) + glm::length(gram[2]), 1e-12);
      if (std::find(turning.begin(), turning.end(), j) == turning.end()) {
        ASSERT_EQ(result.theta[s], pose.theta[s]);
      }
    }
    ASSERT_EQ(result.root_position, joint == 0 ? target : pose.root_position);
  }
}

// A hand's way in steps of a millimetre: through the whole reach, out of it and back.
TEST(InverseKinematicsTest, ThePoseFollowsAHand) {
  const Skeleton person = small_person();
  const int wrist = find_joint(person, "left_wrist");
  const glm::dvec3 shoulder = person.rest_joints[index_of(person, "left_shoulder")];
  Random random;
  double largest = 0;
  for (int way = 0; way < 12; ++way) {
    Pose pose = rest_pose(person);
    glm::dvec3 at = place_of(person, pose, wrist);
    for (int leg = 0; leg < 5; ++leg) {
      glm::dvec3 to = shoulder + random.vector(0.8);
      if (glm::length(to - shoulder) < 0.1) to.x += 0.3;
      const int steps = static_cast<int>(glm::length(to - at) / 0.001) + 1;
      const glm::dvec3 from = at;
      for (int s = 1; s <= steps; ++s) {
        at = from + (to - from) * (static_cast<double>(s) / steps);
        const Pose next = dragged(person, pose, wrist, at);
        // Past the shoulder itself the arm has to swing round, whoever moves it.
        if (glm::length(at - shoulder) > 0.05) largest = std::max(largest, largest_turn(pose, next));
        pose = next;
      }
    }
  }
  RecordProperty("largest_turn_a_millimetre", fmt::format("{:.3g}", largest));
  // The elbow of two bones of 27 and 24 cm opens its last 11 degrees over the last millimetre.
  EXPECT_LT(largest, 0.25);
}

// The result, of one pose, as the target moves by less than can be seen.
TEST(InverseKinematicsTest, IsContinuousInTheTarget) {
  const Skeleton person = small_person();
  Random random;
  int jumps = 0;
  double largest = 0;
  for (int trial = 0; trial < 10000; ++trial) {
    const Pose pose = random.pose(person, 2);
    const int joint = 1 + random.joint(person) % (static_cast<int>(person.size()) - 1);
    const glm::dvec3 target = place_of(person, pose, joint) + random.vector(0.3);
    const double turn = largest_turn(dragged(person, pose, joint, target), dragged(person, pose, joint, target + random.vector(1e-7)));
    largest = std::max(largest, turn);
    jumps += turn > 1e-3;
  }
  RecordProperty("largest_turn", fmt::format("{:.3g}", largest));
  EXPECT_EQ(jumps, 0) << largest;
}

TEST(InverseKinematicsTest, WhatIsNotFiniteChangesNothing) {
  const Skeleton person = small_person();
  const Pose rest = rest_pose(person);
  const int wrist = find_joint(person, "left_wrist");
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    EXPECT_EQ(dragged(person, rest, wrist, {0, bad, 0}), rest);
    EXPECT_EQ(dragged(person, rest, 0, {bad, 0, 0}), rest);
    Pose broken = rest;
    broken.theta[index_of(person, "left_elbow")].y = bad;
    const Pose after = dragged(person, broken, wrist, {0.4, 1, 0});
    EXPECT_EQ(after.theta[index_of(person, "left_shoulder")], glm::dvec3(0.0));
  }
  for (const double far : {1e150, 1e300, std::numeric_limits<double>::max()}) {
    for (const glm::dvec3& theta : dragged(person, rest, wrist, {-far, far, far}).theta) EXPECT_TRUE(std::isfinite(glm::length(theta)));
  }
  // Bones of no length, and of any size.
  for (const double size : {0.0, 1e-200, 1e-3, 1e3, 1e200}) {
    Skeleton scaled = person;
    for (glm::dvec3& joint : scaled.rest_joints) joint *= size;
    const Pose pose = dragged(scaled, rest_pose(scaled), wrist, size * glm::dvec3(0.35, 1.5, 0.2));
    for (const glm::dvec3& theta : pose.theta) EXPECT_TRUE(std::isfinite(glm::length(theta)));
    if (size == 1e-3 || size == 1e3) {
      EXPECT_LT(glm::length(place_of(scaled, pose, wrist) - size * glm::dvec3(0.35, 1.5, 0.2)), 1e-4 * size);
    }
  }
}

TEST(InverseKinematicsTest, NumbersStayNearThoseThatWereShown) {
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1, 2, -1));
  for (double angle = -20; angle < 20; angle += 0.37)
    EXPECT_LT(glm::length(axis_angle_near(rotation_from_axis_angle(angle * axis), (angle + 0.3) * axis) - angle * axis), 1e-9) << angle;
  EXPECT_LT(glm::length(axis_angle_near(glm::dmat3(1.0), 6.0 * axis) - 2 * std::numbers::pi * axis), 1e-9);
  EXPECT_EQ(axis_angle_near(glm::dmat3(1.0), glm::dvec3(0.0)), glm::dvec3(0.0));
}

}  // namespace
}  // namespace arah
