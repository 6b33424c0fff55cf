// Kinematics, canonical pose, normalisation and their gradients against the reference's values (golden 01_kinematics).
#include <gtest/gtest.h>

#include "host/body/canonical.h"
#include "host/body/kinematics_gradient.h"
#include "host/body/pose.h"
#include "tests/golden.h"

namespace arah {
namespace {

// The reference's Rodrigues adds 1e-8 to each component of the axis-angle before it takes the angle: a rotation by a
// differs by up to 1.7e-8 |d(sin t / t)| from an exact one. That, and nothing of ours, is what this limit (absolute, on
// numbers of size 1) leaves room for; up to eight such rotations follow each other.
constexpr double kRodriguesLimit = 1e-7;

struct GoldenRig {
  golden::Case truth{"01_kinematics"};
  Skeleton skeleton;
  std::vector<Pose> poses;

  GoldenRig() {
    skeleton.parents = {-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21};
    skeleton.names = {"pelvis",     "left_hip",    "right_hip",    "spine1",      "left_knee",     "right_knee",
                      "spine2",     "left_ankle",  "right_ankle",  "spine3",      "left_foot",     "right_foot",
                      "neck",       "left_collar", "right_collar", "head",        "left_shoulder", "right_shoulder",
                      "left_elbow", "right_elbow", "left_wrist",   "right_wrist", "left_hand",     "right_hand"};
    skeleton.rest_joints = vectors("in.J");
    const std::vector<glm::dvec3> theta = vectors("in.pose");
    for (std::size_t p = 0; p < theta.size() / 24; ++p) {
      const auto first = theta.begin() + static_cast<std::ptrdiff_t>(24 * p);
      poses.push_back({{first, first + 24}, skeleton.rest_joints[0]});
    }
  }

  std::vector<glm::dvec3> vectors(const std::string& name) const {
    const std::vector<double> values = truth.values(name);
    std::vector<glm::dvec3> result(values.size() / 3);
    for (std::size_t i = 0; i < result.size(); ++i) result[i] = {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
    return result;
  }
};

void append(std::vector<double>* values, const glm::dvec3& v) {
  values->insert(values->end(), {v.x, v.y, v.z});
}
void append(std::vector<double>* values, const glm::dmat4& m) {
  for (int r = 0; r < 4; ++r) values->insert(values->end(), {m[0][r], m[1][r], m[2][r], m[3][r]});
}

TEST(GoldenKinematics, MatchesTheReferenceForward) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const GoldenRig rig;
  const CanonicalPose canonical = make_canonical_pose(rig.skeleton);
  std::vector<double> rotations, joints, rest_to_posed_values, bones, canonical_values;
  for (const Pose& pose : rig.poses) {
    for (const glm::dvec3& theta : pose.theta) {
      const glm::dmat3 rotation = rotation_from_axis_angle(theta);
      for (int r = 0; r < 3; ++r) append(&rotations, {rotation[0][r], rotation[1][r], rotation[2][r]});
    }
    for (const glm::dmat4& frame : forward_kinematics(rig.skeleton, pose)) append(&joints, glm::dvec3(frame[3]));
    for (const glm::dmat4& a : rest_to_posed(rig.skeleton, pose)) append(&rest_to_posed_values, a);
    for (const glm::dmat4& b : bone_transforms(rig.skeleton, canonical, pose)) append(&bones, b);
  }
  for (const glm::dmat4& v : canonical.rest_to_canonical) append(&canonical_values, v);
  golden::expect_close("R", rotations, rig.truth.values("out.R"), kRodriguesLimit);
  golden::expect_close("joints", joints, rig.truth.values("out.joints"), kRodriguesLimit);
  golden::expect_close("A", rest_to_posed_values, rig.truth.values("out.A"), kRodriguesLimit);
  golden::expect_close("B", bones, rig.truth.values("out.B"), kRodriguesLimit);
  golden::expect_golden(rig.truth, "out.V", canonical_values);
}

TEST(GoldenKinematics, NormalisesTheCanonicalBodyToTheCube) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const GoldenRig rig;
  const CanonicalPose canonical = make_canonical_pose(rig.skeleton);
  const std::vector<double> weights = rig.truth.values("in.w");
  const std::vector<glm::dvec3> rest = rig.vectors("in.vT");
  std::vector<glm::dvec3> vertices;
  std::vector<double> values;
  for (std::size_t i = 0; i < rest.size(); ++i) {
    glm::dvec4 sum(0.0);
    for (std::size_t b = 0; b < 24; ++b) {
      sum += weights[24 * i + b] * (canonical.rest_to_canonical[b] * glm::dvec4(rest[i], 1.0));
    }
    vertices.emplace_back(sum);
    append(&values, vertices.back());
  }
  golden::expect_golden(rig.truth, "out.vc", values);
  const CubeNormalization cube = cube_normalization(vertices);
  golden::expect_golden(rig.truth, "out.cmin", cube.cmin);
  golden::expect_golden(rig.truth, "out.cmax", cube.cmax);
  std::vector<double> center, n, joints, x;
  append(&center, cube.center);
  golden::expect_golden(rig.truth, "out.center", center);
  for (const glm::dvec3& point : rig.vectors("in.x")) append(&n, cube.to_cube(point));
  for (const glm::dvec3& joint : rig.skeleton.rest_joints) append(&joints, cube.to_cube(joint));
  for (const glm::dvec3& point : rig.vectors("in.xn")) append(&x, cube.from_cube(point));
  golden::expect_golden(rig.truth, "out.n", n);
  golden::expect_golden(rig.truth, "out.nJ", joints);
  golden::expect_golden(rig.truth, "out.x_from_n", x);
}

TEST(GoldenKinematics, MatchesTheReferenceBackward) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const GoldenRig rig;
  const CanonicalPose canonical = make_canonical_pose(rig.skeleton);
  const std::vector<double> bone_weights = rig.truth.values("in.G_B");
  const std::vector<glm::dvec3> joint_weights = rig.vectors("in.G_j");
  std::vector<double> theta, rest;
  std::vector<glm::dvec3> rest_sum(24, glm::dvec3(0.0));
  for (std::size_t p = 0; p < rig.poses.size(); ++p) {
    std::vector<glm::dmat4> bones(24, glm::dmat4(0.0));
    for (std::size_t i = 0; i < 24 * 12; ++i) {
      bones[i / 12][static_cast<int>(i % 4)][static_cast<int>(i % 12 / 4)] = bone_weights[24 * 12 * p + i];
    }
    const KinematicsGradient gradient =
        kinematics_gradient(rig.skeleton, canonical, rig.poses[p], bones, std::span(joint_weights).subspan(24 * p, 24));
    for (std::size_t j = 0; j < 24; ++j) {
      append(&theta, gradient.theta[j]);
      rest_sum[j] += gradient.rest_joints[j];
    }
  }
  for (const glm::dvec3& gradient : rest_sum) append(&rest, gradient);
  // The reference's 1e-8 again, times the size of the gradients (some 16).
  golden::expect_close("dL/dpose", theta, rig.truth.values("grad.pose"), 16 * kRodriguesLimit);
  golden::expect_close("dL/dJ", rest, rig.truth.values("grad.J"), 16 * kRodriguesLimit);
}

}  // namespace
}  // namespace arah
