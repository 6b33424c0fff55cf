#include "viewer/viewpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <numbers>
#include <stdexcept>

namespace arah {
namespace {

constexpr double kSteepest = 89.0 * std::numbers::pi / 180.0;
constexpr double kNearest = 0.05, kFarthest = 100;  // metres

struct Axes {
  glm::dvec3 right, down, forward;
};

Axes axes(const Viewpoint& viewpoint) {
  const glm::dvec3 up = viewpoint.up == UpAxis::y ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  const glm::dvec3 front = viewpoint.up == UpAxis::y ? glm::dvec3(0, 0, 1) : glm::dvec3(0, -1, 0);
  const glm::dvec3 level = std::cos(viewpoint.yaw) * front + std::sin(viewpoint.yaw) * glm::cross(up, front);
  const glm::dvec3 forward = -(std::cos(viewpoint.pitch) * level + std::sin(viewpoint.pitch) * up);
  const glm::dvec3 right = glm::normalize(glm::cross(forward, up));
  return {right, glm::cross(forward, right), forward};
}

}  // namespace

Viewpoint viewpoint_around(std::span<const glm::vec3> vertices, UpAxis up) {
  // It knows how far away a body fits; its square picture has the field of view from top to bottom too.
  const Camera around = orbit_camera(vertices, up, 0, 100);
  Viewpoint viewpoint;
  viewpoint.up = up;
  viewpoint.field_of_view = 2 * std::atan(0.5 * around.height / around.K[1][1]);
  glm::dvec3 low(vertices[0]), high(vertices[0]);
  for (const glm::vec3& vertex : vertices) {
    low = glm::min(low, glm::dvec3(vertex));
    high = glm::max(high, glm::dvec3(vertex));
  }
  viewpoint.target = 0.5 * (low + high);
  viewpoint.distance = std::clamp(glm::length(around.center() - viewpoint.target), kNearest, kFarthest);
  return viewpoint;
}

Viewpoint viewpoint_of(const Camera& camera, const glm::dvec3& target, UpAxis up) {
  const glm::dvec3 axis = up == UpAxis::y ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  const glm::dvec3 front = up == UpAxis::y ? glm::dvec3(0, 0, 1) : glm::dvec3(0, -1, 0);
  const glm::dvec3 from = camera.center() - target;
  const double height = glm::dot(from, axis);
  const glm::dvec3 level = from - height * axis;
  Viewpoint viewpoint;
  viewpoint.target = target;
  viewpoint.up = up;
  viewpoint.yaw = std::atan2(glm::dot(glm::cross(axis, front), level), glm::dot(front, level));
  viewpoint.pitch = std::clamp(std::atan2(height, glm::length(level)), -kSteepest, kSteepest);
  viewpoint.distance = std::clamp(glm::length(from), kNearest, kFarthest);
  viewpoint.field_of_view = std::clamp(2 * std::atan(0.5 * camera.height / camera.K[1][1]), 0.05, 2.5);
  return viewpoint;
}

Camera camera_at(const Viewpoint& viewpoint, int width, int height) {
  if (width < 1 || height < 1 || width > 8192 || height > 8192) throw std::invalid_argument(fmt::format("a camera of {} x {} pixels", width, height));
  const Axes to = axes(viewpoint);
  Camera camera;
  camera.name = "viewpoint";
  camera.width = width;
  camera.height = height;
  camera.K[0][0] = camera.K[1][1] = 0.5 * height / std::tan(0.5 * viewpoint.field_of_view);
  camera.K[2] = {0.5 * (width - 1), 0.5 * (height - 1), 1.0};
  camera.R = glm::transpose(glm::dmat3(to.right, to.down, to.forward));
  camera.T = -(camera.R * (viewpoint.target - viewpoint.distance * to.forward));
  return camera;
}

Viewpoint panned(const Viewpoint& viewpoint, glm::dvec2 pixels, int height) {
  const Axes to = axes(viewpoint);
  const double metres_a_pixel = 2 * viewpoint.distance * std::tan(0.5 * viewpoint.field_of_view) / height;
  Viewpoint moved = viewpoint;
  moved.target -= metres_a_pixel * (pixels.x * to.right + pixels.y * to.down);
  return moved;
}

Viewpoint orbited(const Viewpoint& viewpoint, glm::dvec2 pixels, int height) {
  const double radians_a_pixel = std::numbers::pi / height;
  Viewpoint turned = viewpoint;
  turned.yaw = std::remainder(viewpoint.yaw - radians_a_pixel * pixels.x, 2 * std::numbers::pi);
  turned.pitch = std::clamp(viewpoint.pitch + radians_a_pixel * pixels.y, -kSteepest, kSteepest);
  return turned;
}

Viewpoint dollied(const Viewpoint& viewpoint, double notches) {
  Viewpoint moved = viewpoint;
  moved.distance = std::clamp(viewpoint.distance * std::pow(0.9, notches), kNearest, kFarthest);
  return moved;
}

}  // namespace arah
