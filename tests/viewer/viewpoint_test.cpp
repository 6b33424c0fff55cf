#include "viewer/viewpoint.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

namespace arah {
namespace {

const std::vector<glm::vec3> kBody{{-0.3f, 0, -0.2f}, {0.3f, 0, 0.2f}, {0, 1.8f, 0}};

TEST(ViewpointTest, AtFirstItIsTheOrbitCamera) {
  for (const UpAxis up : {UpAxis::y, UpAxis::z}) {
    const Camera expected = orbit_camera(kBody, up, 0, 200), found = camera_at(viewpoint_around(kBody, up), 200, 200);
    EXPECT_NEAR(glm::length(expected.center() - found.center()), 0, 1e-12);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(glm::length(expected.R[c] - found.R[c]), 0, 1e-12);
    EXPECT_NEAR(expected.K[0][0], found.K[0][0], 1e-9);
  }
}

TEST(ViewpointTest, TurnsAsTheOrbitCameraDoes) {
  Viewpoint viewpoint = viewpoint_around(kBody, UpAxis::z);
  viewpoint.yaw = 70 * std::numbers::pi / 180;
  EXPECT_NEAR(glm::length(orbit_camera(kBody, UpAxis::z, 70, 200).center() - camera_at(viewpoint, 200, 200).center()), 0, 1e-12);
}

TEST(ViewpointTest, WhatAHandHoldsFollowsIt) {
  Viewpoint viewpoint = viewpoint_around(kBody, UpAxis::y);
  viewpoint.yaw = 0.4;
  viewpoint.pitch = -0.3;
  const glm::dvec2 before = camera_at(viewpoint, 640, 480).project(viewpoint.target);
  const glm::dvec2 after = camera_at(panned(viewpoint, {30, -12}, 480), 640, 480).project(viewpoint.target);
  EXPECT_NEAR(after.x - before.x, 30, 1e-9);
  EXPECT_NEAR(after.y - before.y, -12, 1e-9);

  // The near side of what is in the middle goes the way the hand goes.
  const Camera camera = camera_at(viewpoint, 640, 480);
  const glm::dvec3 near = viewpoint.target - 0.2 * glm::dvec3(camera.R[0][2], camera.R[1][2], camera.R[2][2]);
  const glm::dvec2 right = camera_at(orbited(viewpoint, {10, 0}, 480), 640, 480).project(near), down = camera_at(orbited(viewpoint, {0, 10}, 480), 640, 480).project(near);
  EXPECT_GT(right.x, before.x + 1);
  EXPECT_GT(down.y, before.y + 1);
}

TEST(ViewpointTest, IsFoundAgainFromItsCamera) {
  for (const UpAxis up : {UpAxis::y, UpAxis::z}) {
    Viewpoint viewpoint = viewpoint_around(kBody, up);
    viewpoint.yaw = -2.1;
    viewpoint.pitch = 0.4;
    const Viewpoint again = viewpoint_of(camera_at(viewpoint, 640, 480), viewpoint.target, up);
    EXPECT_NEAR(again.yaw, viewpoint.yaw, 1e-12);
    EXPECT_NEAR(again.pitch, viewpoint.pitch, 1e-12);
    EXPECT_NEAR(again.distance, viewpoint.distance, 1e-12);
    EXPECT_NEAR(again.field_of_view, viewpoint.field_of_view, 1e-12);
  }
}

TEST(ViewpointTest, StaysWithinItsBounds) {
  Viewpoint viewpoint = viewpoint_around(kBody, UpAxis::y);
  EXPECT_LT(orbited(viewpoint, {0, 1e6}, 480).pitch, 0.5 * std::numbers::pi);
  EXPECT_EQ(dollied(viewpoint, 1e4).distance, 0.05);
  EXPECT_EQ(dollied(viewpoint, -1e4).distance, 100);
  EXPECT_LT(dollied(viewpoint, 1).distance, viewpoint.distance);
  EXPECT_THROW(camera_at(viewpoint, 0, 10), std::invalid_argument);
  EXPECT_THROW(viewpoint_around({}, UpAxis::y), std::invalid_argument);
}

}  // namespace
}  // namespace arah
