#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/constants.hpp>
#include <glm/matrix.hpp>
#include <random>

#include "host/body/canonical.h"
#include "host/body/kinematics_gradient.h"
#include "host/body/pose.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

double difference(const glm::dmat3& a, const glm::dmat3& b) {
  double largest = 0.0;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) largest = std::max(largest, std::abs(a[c][r] - b[c][r]));
  }
  return largest;
}

TEST(Rotation, IsARotationAtEveryAngle) {
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1.0, -2.0, 0.5));
  for (double angle :
       {0.0, 1e-300, 1e-8, 1e-4, 0.5, glm::pi<double>() - 1e-7, glm::pi<double>(), 10 * glm::pi<double>()}) {
    const glm::dmat3 rotation = rotation_from_axis_angle(angle * axis);
    EXPECT_LT(difference(glm::transpose(rotation) * rotation, glm::dmat3(1.0)), 1e-13) << angle;
    EXPECT_NEAR(glm::determinant(rotation), 1.0, 1e-13) << angle;
    EXPECT_LT(glm::length(rotation * axis - axis), 1e-13) << angle;
    EXPECT_NEAR(rotation[0][0] + rotation[1][1] + rotation[2][2], 1.0 + 2.0 * std::cos(angle), 1e-13) << angle;
  }
}

TEST(Rotation, ComesBackFromItsMatrix) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (double angle : {0.0, 1e-13, 1e-9, 1e-5, 0.3, 2.0, 3.1, glm::pi<double>() - 1e-9}) {
    for (int trial = 0; trial < 20; ++trial) {
      const glm::dvec3 theta = angle * glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
      const glm::dvec3 back = axis_angle_from_rotation(rotation_from_axis_angle(theta));
      EXPECT_LT(glm::length(back - theta), 1e-14 + 1e-13 * angle) << angle;
    }
  }
  // At π the axis has two signs; the matrix is the same.
  const glm::dmat3 half_turn = rotation_from_axis_angle({0.0, glm::pi<double>(), 0.0});
  EXPECT_LT(difference(rotation_from_axis_angle(axis_angle_from_rotation(half_turn)), half_turn), 1e-14);
}

TEST(Kinematics, LeavesARestingBodyWhereItIs) {
  const BodyTemplate body = tetrahedron(7);
  const std::vector<glm::vec3> posed = posed_vertices(body, rest_pose(body.skeleton));
  for (std::size_t i = 0; i < posed.size(); ++i) EXPECT_LT(glm::length(posed[i] - body.vertices[i]), 1e-7f);
}

TEST(Kinematics, TurnsAboutTheRootAndMovesWithIt) {
  const BodyTemplate body = tetrahedron(5);
  Pose pose = rest_pose(body.skeleton);
  pose.theta[0] = {0.0, 0.0, glm::half_pi<double>()};
  pose.root_position = {3.0, 4.0, 5.0};
  // Vertex 1 is 0.3 m along x from the root; a quarter turn about z takes that to +y.
  const glm::vec3 moved = posed_vertices(body, pose)[1];
  EXPECT_LT(glm::length(moved - glm::vec3(3.0f, 4.3f, 5.0f)), 1e-6f);
}

TEST(Kinematics, RefusesAPoseOfAnotherSkeleton) {
  EXPECT_THROW(forward_kinematics(chain_skeleton(3), rest_pose(chain_skeleton(2))), std::invalid_argument);
}

TEST(KinematicsGradient, AgreesWithCentralDifferences) {
  // SMPL's leg names on an odd rig in a T-pose, so that the canonical turn's centre is differentiated too.
  Skeleton skeleton;
  skeleton.names = {"pelvis",        "left_hip",   "right_hip",      "left_knee",  "right_knee",
                    "left_shoulder", "left_elbow", "right_shoulder", "right_elbow"};
  skeleton.parents = {-1, 0, 0, 1, 2, 0, 5, 0, 7};
  skeleton.rest_joints = {{0.0, 1.0, 0.0}, {0.1, 0.9, 0.02},   {-0.1, 0.9, 0.01}, {0.12, 0.5, 0.0}, {-0.11, 0.5, 0.03},
                          {0.2, 1.4, 0.0}, {0.5, 1.41, -0.02}, {-0.2, 1.4, 0.0},  {-0.5, 1.38, 0.0}};
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  auto vector = [&] { return glm::dvec3(normal(random), normal(random), normal(random)); };
  Pose pose = rest_pose(skeleton);
  for (std::size_t j = 0; j < skeleton.size(); ++j) pose.theta[j] = (j % 3 == 0 ? 0.03 : 1.1) * vector();
  pose.theta[4] = glm::dvec3(0.0);
  pose.theta[5] = glm::pi<double>() * glm::normalize(vector());
  std::vector<glm::dmat4> weights(skeleton.size(), glm::dmat4(0.0));
  std::vector<glm::dvec3> joint_weights;
  for (glm::dmat4& weight : weights) {
    for (int c = 0; c < 4; ++c) weight[c] = glm::dvec4(vector(), 0.0);
    joint_weights.push_back(vector());
  }
  auto functional = [&](const Skeleton& rig, const Pose& at) {
    const std::vector<glm::dmat4> bones = bone_transforms(rig, make_canonical_pose(rig), at);
    const std::vector<glm::dmat4> frames = forward_kinematics(rig, at);
    double sum = 0.0;
    for (std::size_t b = 0; b < bones.size(); ++b) {
      for (int c = 0; c < 4; ++c) sum += glm::dot(weights[b][c], bones[b][c]);
      sum += glm::dot(joint_weights[b], glm::dvec3(frames[b][3]));
    }
    return sum;
  };
  const KinematicsGradient gradient =
      kinematics_gradient(skeleton, make_canonical_pose(skeleton), pose, weights, joint_weights);
  const double step = 1e-6;
  double largest = 0.0;
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    for (int k = 0; k < 3; ++k) {
      Pose up = pose, down = pose;
      up.theta[j][k] += step;
      down.theta[j][k] -= step;
      const double theta = (functional(skeleton, up) - functional(skeleton, down)) / (2.0 * step);
      Skeleton higher = skeleton, lower = skeleton;
      higher.rest_joints[j][k] += step;
      lower.rest_joints[j][k] -= step;
      const double rest = (functional(higher, pose) - functional(lower, pose)) / (2.0 * step);
      largest =
          std::max({largest, std::abs(theta - gradient.theta[j][k]), std::abs(rest - gradient.rest_joints[j][k])});
    }
  }
  std::printf("  largest error against central differences %.2e\n", largest);
  EXPECT_LT(largest, 2e-8);  // rounding of a functional of size 20 over a step of 2e-6
}

TEST(KinematicsGradient, HasNoStepWhereTheSeriesEnds) {
  const glm::dmat3 weights(0.3, -1.2, 0.7, 2.0, 0.1, -0.4, -0.9, 1.5, 0.8);
  const glm::dvec3 axis = glm::normalize(glm::dvec3(0.2, 0.7, -0.3));
  const glm::dvec3 below = axis_angle_gradient(0.1 * (1.0 - 1e-12) * axis, weights);
  const glm::dvec3 above = axis_angle_gradient(0.1 * (1.0 + 1e-12) * axis, weights);
  EXPECT_LT(glm::length(below - above), 1e-11);
}

// The angle of a thigh off the downward vertical in the canonical pose, degrees.
double canonical_thigh(const Skeleton& skeleton, const std::string& side) {
  const CanonicalPose canonical = make_canonical_pose(skeleton);
  const auto hip = static_cast<std::size_t>(find_joint(skeleton, side + "_hip"));
  const auto knee = static_cast<std::size_t>(find_joint(skeleton, side + "_knee"));
  const glm::dvec3 thigh = skeleton.rest_joints[knee] - skeleton.rest_joints[hip];
  const glm::dvec3 turned = glm::dmat3(canonical.rest_to_canonical[knee]) * thigh;
  EXPECT_GT((side == "left" ? 1.0 : -1.0) * turned.x, 0.0);
  return glm::degrees(std::acos(-turned.y / glm::length(turned)));
}

Skeleton legs(const glm::dvec3& thigh) {
  Skeleton skeleton;
  skeleton.names = {"pelvis", "left_hip", "right_hip", "left_knee", "right_knee"};
  skeleton.parents = {-1, 0, 0, 1, 2};
  const glm::dvec3 mirrored(-thigh.x, thigh.y, thigh.z);
  skeleton.rest_joints = {{0.0, 1.0, 0.0}, {0.1, 0.9, 0.0}, {-0.1, 0.9, 0.0}};
  skeleton.rest_joints.push_back(skeleton.rest_joints[1] + thigh);
  skeleton.rest_joints.push_back(skeleton.rest_joints[2] + mirrored);
  return skeleton;
}

TEST(CanonicalPose, TurnsAThighOutToFortyFiveDegrees) {
  for (const glm::dvec3 thigh :
       {glm::dvec3(0.0, -0.4, 0.0), glm::dvec3(0.05, -0.4, 0.07), glm::dvec3(-0.03, -0.4, -0.02)}) {
    EXPECT_NEAR(canonical_thigh(legs(thigh), "left"), 45.0, 1e-9);
    EXPECT_NEAR(canonical_thigh(legs(thigh), "right"), 45.0, 1e-9);
  }
}

TEST(CanonicalPose, NeverTurnsInwardAndLeavesOtherRigsAtRest) {
  const glm::dvec3 wide(0.4, -0.3, 0.0);  // stands farther out already
  EXPECT_EQ(make_canonical_pose(legs(wide)).rest_to_canonical[3], glm::dmat4(1.0));
  for (const glm::dmat4& v : make_canonical_pose(chain_skeleton(4)).rest_to_canonical) EXPECT_EQ(v, glm::dmat4(1.0));
}

TEST(CanonicalPose, BonesLeaveACanonicalBodyInItsRestPose) {
  const Skeleton skeleton = legs({0.02, -0.4, 0.01});
  const CanonicalPose canonical = make_canonical_pose(skeleton);
  const std::vector<glm::dmat4> bones = bone_transforms(skeleton, canonical, rest_pose(skeleton));
  for (std::size_t b = 0; b < bones.size(); ++b) {
    const glm::dmat4 product = bones[b] * canonical.rest_to_canonical[b];
    for (int c = 0; c < 4; ++c) EXPECT_LT(glm::length(product[c] - glm::dmat4(1.0)[c]), 1e-14) << b;
  }
}

TEST(CanonicalPose, BonesReachToTheMiddleOfTheirChildren) {
  Skeleton skeleton;
  skeleton.names = {"root", "left", "right", "hand"};
  skeleton.parents = {-1, 0, 0, 1};
  skeleton.rest_joints = {{0, 1, 0}, {1, 2, 0}, {-1, 4, 1}, {2, 2, 0}};
  CanonicalPose canonical{std::vector<glm::dmat4>(4, glm::dmat4(1.0))};
  canonical.rest_to_canonical[3][3] = glm::dvec4(0, 0, 5, 1);  // moved by 5 m
  const auto segments = bone_segments(skeleton, canonical);
  ASSERT_EQ(segments.size(), 4u);
  EXPECT_EQ(segments[0], std::pair(glm::dvec3(0, 1, 0), glm::dvec3(0, 3, 0.5)));
  EXPECT_EQ(segments[1], std::pair(glm::dvec3(1, 2, 0), glm::dvec3(2, 2, 5)));
  for (const size_t last : {2u, 3u}) EXPECT_EQ(segments[last].first, segments[last].second);
}

TEST(CubeNormalization, PadsByFivePercentAndInverts) {
  for (double size : {1e-3, 1.0, 1e3}) {
    const std::vector<glm::dvec3> vertices = {size * glm::dvec3(1.0, 2.0, 3.0), size * glm::dvec3(1.2, 3.9, 3.1)};
    const CubeNormalization cube = cube_normalization(vertices);
    EXPECT_NEAR(cube.to_cube(vertices[1]).y, 1.0 - 0.1 / 1.1, 1e-12);  // the greatest coordinate: 5 % below the face
    EXPECT_NEAR(cube.metres_per_unit(), 1.1 * 1.9 * size / 2.0, 1e-12 * size);
    const glm::dvec3 point = size * glm::dvec3(-0.3, 1.0, 9.0);
    EXPECT_LT(glm::length(cube.from_cube(cube.to_cube(point)) - point), 1e-13 * size * 10.0);
  }
  const std::vector<glm::dvec3> point(3, glm::dvec3(1.0));
  expect_input_error([&] { cube_normalization(point); }, {"extent"});
}

}  // namespace
}  // namespace arah
