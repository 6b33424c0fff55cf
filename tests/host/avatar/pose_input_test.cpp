// What an SDF that follows the pose reads of it.
#include <gtest/gtest.h>

#include <numbers>

#include "host/avatar/avatar.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

Avatar posed_avatar(PoseConditioning kind) {
  AvatarSpec spec = preset_spec("tiny");
  spec.sdf.pose = kind;
  if (kind != PoseConditioning::none) spec.sdf.pose_width = 8, spec.sdf.pose_hidden_layers = 1;
  return make_avatar(spec, tetrahedron(3), {0}, 1);
}

TEST(PoseInput, HoldsRotationsByRowThenJointsInTheCube) {
  const Avatar avatar = posed_avatar(PoseConditioning::low_rank);
  Pose pose = rest_pose(avatar.body.skeleton);
  const double quarter = std::numbers::pi / 2;
  pose.theta[0] = {0.3, -1.1, 0.7};
  pose.theta[1] = {0, 0, quarter};
  pose.theta[2] = {quarter, 0, 0};
  pose.root_position = {4, 5, 6};
  const std::vector<float> input = pose_input(avatar, pose);
  ASSERT_EQ(input.size(), 3u * (9 + 3));
  const double expected[27] = {1, 0, 0, 0, 1, 0, 0, 0, 1,    // of the root nothing, however it is turned
                               0, -1, 0, 1, 0, 0, 0, 0, 1,   // x to y, y to −x
                               1, 0, 0, 0, 0, -1, 0, 1, 0};  // y to z, z to −y
  for (size_t i = 0; i < 27; ++i) EXPECT_NEAR(input[i], expected[i], 1e-7) << i;
  for (size_t joint = 0; joint < 3; ++joint)
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_FLOAT_EQ(input[27 + 3 * joint + static_cast<size_t>(axis)], static_cast<float>(avatar.cube.to_cube(avatar.body.skeleton.rest_joints[joint])[axis]));
}

TEST(PoseInput, IsEmptyWhereNothingReadsIt) {
  const Avatar avatar = posed_avatar(PoseConditioning::none);
  EXPECT_TRUE(pose_input(avatar, rest_pose(avatar.body.skeleton)).empty());
}

TEST(PoseInput, RefusesAnotherNumberOfJoints) {
  const Avatar avatar = posed_avatar(PoseConditioning::hypernetwork);
  Pose pose = rest_pose(avatar.body.skeleton);
  pose.theta.emplace_back(0.0);
  EXPECT_THROW(pose_input(avatar, pose), std::invalid_argument);
}

}  // namespace
}  // namespace arah
