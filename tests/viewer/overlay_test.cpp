#include "viewer/overlay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <numbers>

#include "host/body/inverse_kinematics.h"
#include "tests/viewer/small_person.h"

namespace arah {
namespace {

glm::dvec3 forward_of(const Camera& camera) { return {camera.R[0][2], camera.R[1][2], camera.R[2][2]}; }

bool inside(const Camera& camera, const glm::dvec2& pixel) {
  return pixel.x >= -0.5 - 1e-9 && pixel.y >= -0.5 - 1e-9 && pixel.x <= camera.width - 0.5 + 1e-9 && pixel.y <= camera.height - 0.5 + 1e-9;
}

// A ball of latitudes and longitudes, radius 0.5 m around (0, 1, 0).
BodyTemplate ball(int rows, int columns) {
  BodyTemplate body;
  body.skeleton = {{"root"}, {-1}, {{0, 1, 0}}};
  for (int row = 0; row <= rows; ++row) {
    const double pitch = std::numbers::pi * (row / static_cast<double>(rows) - 0.5);
    for (int column = 0; column < columns; ++column) {
      const double yaw = 2 * std::numbers::pi * column / columns;
      const double round = row == 0 || row == rows ? 0.0 : 0.5 * std::cos(pitch);
      body.vertices.push_back(glm::vec3(round * std::sin(yaw), 1 + 0.5 * std::sin(pitch), round * std::cos(yaw)));
    }
  }
  const auto at = [&](int row, int column) { return static_cast<glm::uint>(row * columns + column % columns); };
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      if (row > 0) body.triangles.push_back({at(row, column), at(row, column + 1), at(row + 1, column)});
      if (row < rows - 1) body.triangles.push_back({at(row, column + 1), at(row + 1, column + 1), at(row + 1, column)});
    }
  return body;
}

TEST(LineInPictureTest, IsWhereTheCameraSeesIt) {
  const Camera camera = camera_in_front();
  const glm::dvec3 a(-0.2, 0.8, 0.1), b(0.3, 1.2, -0.1);
  const auto line = line_in_picture(camera, a, b, {1, 2, 3, 4});
  ASSERT_TRUE(line);
  EXPECT_NEAR(glm::length(line->from - camera.project(a)), 0, 1e-9);
  EXPECT_NEAR(glm::length(line->to - camera.project(b)), 0, 1e-9);
  EXPECT_EQ(line->color, OverlayColor(1, 2, 3, 4));
}

TEST(LineInPictureTest, EndsAtTheNearPlaneAndAtTheBorders) {
  const Camera camera = camera_in_front();
  const glm::dvec3 eye = camera.center(), forward = forward_of(camera), target(0, 0.9, 0), side(0.05, 0, 0);
  EXPECT_FALSE(line_in_picture(camera, eye - forward, eye - 2.0 * forward, {}));  // behind
  EXPECT_FALSE(line_in_picture(camera, eye - forward, eye + 0.009 * forward, {}));
  EXPECT_FALSE(line_in_picture(camera, target + glm::dvec3(9, 0, 0), target + glm::dvec3(9, 1, 0), {}));  // beside
  EXPECT_FALSE(line_in_picture(camera, target, {0, std::nan(""), 0}, {}));
  EXPECT_FALSE(line_in_picture(camera, target, {std::numeric_limits<double>::infinity(), 0, 0}, {}));
  // From behind the camera, beside it, to the middle of the picture: it comes in at the border, on the line between.
  const auto line = line_in_picture(camera, target, eye - forward + side, {});
  ASSERT_TRUE(line);
  EXPECT_NEAR(glm::length(line->from - camera.project(target)), 0, 1e-9);
  EXPECT_NEAR(line->to.x, camera.width - 0.5, 1e-6);
  EXPECT_NEAR(line->to.y, camera.project(target).y, 1e-6);
  const auto across = line_in_picture(camera, target - glm::dvec3(50, 0, 0), target + glm::dvec3(50, 0, 0), {});
  ASSERT_TRUE(across);
  EXPECT_NEAR(across->from.x, -0.5, 1e-9);
  EXPECT_NEAR(across->to.x, 639.5, 1e-9);
}

TEST(SkeletonOverlayTest, HasABoneForEachJointButTheRoot) {
  const Skeleton person = smpl_person();
  const Camera camera = camera_in_front();
  const std::vector<glm::dvec3> joints = posed_joints(person, rest_pose(person));
  const SkeletonOverlay overlay = skeleton_overlay(camera, person, joints);
  EXPECT_EQ(overlay.bones.size(), 23u);
  ASSERT_EQ(overlay.joints.size(), 24u);
  OverlayColor left, right, middle;
  for (const OverlayJoint& joint : overlay.joints) {
    EXPECT_NEAR(glm::length(joint.place - camera.project(joints[static_cast<std::size_t>(joint.joint)])), 0, 1e-9);
    if (joint.joint == find_joint(person, "left_knee")) left = joint.color;
    if (joint.joint == find_joint(person, "right_knee")) right = joint.color;
    if (joint.joint == find_joint(person, "neck")) middle = joint.color;
  }
  EXPECT_TRUE(std::is_sorted(overlay.joints.begin(), overlay.joints.end(), [](const auto& a, const auto& b) { return a.depth > b.depth; }));
  EXPECT_NE(left, right);
  EXPECT_NE(left, middle);
  EXPECT_GT(left.b, left.r);  // blue
  EXPECT_GT(right.r, right.b);
  EXPECT_THROW(skeleton_overlay(camera, person, std::span(joints).first(3)), std::invalid_argument);
}

TEST(SkeletonOverlayTest, DropsWhatIsBehindTheCamera) {
  const Skeleton person = smpl_person();
  Viewpoint within;  // the camera at the chest, looking down: what is above is behind it
  within.target = {0, 0.2, 0};
  within.distance = 1.1;
  within.pitch = 1.55;
  within.field_of_view = 2.5;
  const Camera camera = camera_at(within, 300, 200);
  const std::vector<glm::dvec3> joints = posed_joints(person, rest_pose(person));
  const SkeletonOverlay overlay = skeleton_overlay(camera, person, joints);
  std::vector<bool> shown(24, false);
  for (const OverlayJoint& joint : overlay.joints) {
    shown[static_cast<std::size_t>(joint.joint)] = true;
    EXPECT_GE(joint.depth, 0.01);
    EXPECT_TRUE(inside(camera, joint.place));
  }
  for (const OverlayLine& bone : overlay.bones) EXPECT_TRUE(inside(camera, bone.from) && inside(camera, bone.to));
  EXPECT_TRUE(shown[joint_named(person, "left_knee")]);
  EXPECT_FALSE(shown[joint_named(person, "head")]);
  EXPECT_FALSE(shown[joint_named(person, "left_shoulder")]);
}

TEST(TemplateOverlayTest, OutlinesAndRingsOfABall) {
  const BodyTemplate body = ball(24, 48);
  const TemplateOverlay overlay(body);
  // Euler: V − E + F = 2. The poles are 48 vertices each, as at a texture's seam, in one place.
  EXPECT_EQ(static_cast<long>(overlay.edges().size()), 2 + 23 * 48 - 2 + static_cast<long>(body.triangles.size()));
  const Camera camera = camera_in_front();
  const std::vector<OverlayLine> lines = overlay.lines(camera, body.vertices);
  const glm::dvec3 middle(0, 1, 0);
  const double distance = glm::length(camera.center() - middle);
  // The outline of a ball is a circle of the radius tan(asin(r / d)) f, but for perspective; the mesh is a little within.
  const double radius = camera.K[1][1] * 0.5 / std::sqrt(distance * distance - 0.25);
  std::size_t outline = 0, rings = 0;
  for (const OverlayLine& line : lines) {
    const double from = glm::length(line.from - camera.project(middle)), to = glm::length(line.to - camera.project(middle));
    EXPECT_LT(std::max(from, to), 1.03 * radius);
    if (line.color.a > 200) {
      ++outline;
      EXPECT_GT(std::min(from, to), 0.9 * radius);
    } else {
      ++rings;
    }
  }
  EXPECT_GT(outline, 24u);
  EXPECT_LT(outline, 150u);
  // Half of the rings' lines face the camera, a little less as it is near.
  EXPECT_GT(rings, overlay.rings().size() / 3);
  EXPECT_LT(rings, overlay.rings().size() / 2 + 48);
  // 48 levels, each crossing 48 columns: two triangles each, in the rows of triangles at the poles one.
  EXPECT_NEAR(static_cast<double>(overlay.rings().size()), 48 * 96, 48 * 12);
}

TEST(TemplateOverlayTest, RingsLieOnTheMeshWhereverItGoes) {
  const BodyTemplate body = ball(12, 16);
  const TemplateOverlay overlay(body);
  for (const TemplateOverlay::Ring& ring : overlay.rings()) {
    double levels[2];
    for (std::size_t end = 0; end < 2; ++end) {
      EXPECT_GE(ring.part[end], 0);
      EXPECT_LE(ring.part[end], 1);
      levels[end] = glm::mix(static_cast<double>(body.vertices[ring.from[end]].y), static_cast<double>(body.vertices[ring.to[end]].y), ring.part[end]);
    }
    EXPECT_NEAR(levels[0], levels[1], 1e-6);
  }
  // Moved out of view, nothing is left; behind the camera neither.
  std::vector<glm::vec3> moved = body.vertices;
  for (glm::vec3& vertex : moved) vertex.x += 20;
  EXPECT_THAT(overlay.lines(camera_in_front(), moved), testing::IsEmpty());
  for (glm::vec3& vertex : moved) vertex += glm::vec3(-20, 0, 10);
  EXPECT_THAT(overlay.lines(camera_in_front(), moved), testing::IsEmpty());
  EXPECT_THROW(overlay.lines(camera_in_front(), std::span(moved).first(3)), std::invalid_argument);
}

TEST(TemplateOverlayTest, OpenAndBadMeshes) {
  BodyTemplate sheet;
  sheet.vertices = {{-0.2f, 0.8f, 0}, {0.2f, 0.8f, 0}, {0, 1.1f, 0}};
  sheet.triangles = {{0, 1, 2}};
  const auto outlines = [](const std::vector<OverlayLine>& lines) { return std::count_if(lines.begin(), lines.end(), [](const OverlayLine& line) { return line.color.a > 200; }); };
  EXPECT_EQ(outlines(TemplateOverlay(sheet).lines(camera_in_front(), sheet.vertices)), 3);
  sheet.triangles = {{0, 2, 1}};  // from behind
  EXPECT_THAT(TemplateOverlay(sheet).lines(camera_in_front(), sheet.vertices), testing::IsEmpty());
  sheet.triangles = {{0, 1, 3}};
  EXPECT_THROW(TemplateOverlay{sheet}, std::invalid_argument);
  EXPECT_THAT(TemplateOverlay(BodyTemplate{}).lines(camera_in_front(), {}), testing::IsEmpty());
}

}  // namespace
}  // namespace arah
