#include "host/rendering/orbit_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <numbers>
#include <stdexcept>

namespace arah {
namespace {

constexpr double kHalfView = 15.0 * std::numbers::pi / 180.0;
constexpr double kClothes = 0.10;  // metres
constexpr double kFilled = 0.9;    // of the picture's half, by the body and its clothes

}  // namespace

Camera orbit_camera(std::span<const glm::vec3> vertices, UpAxis up, double degrees, int size) {
  if (vertices.empty() || size < 1)
    throw std::invalid_argument(fmt::format("orbit camera: {} vertices, {} pixels", vertices.size(), size));
  glm::dvec3 low(vertices[0]), high(vertices[0]);
  for (const glm::vec3& vertex : vertices) {
    low = glm::min(low, glm::dvec3(vertex));
    high = glm::max(high, glm::dvec3(vertex));
  }
  const glm::dvec3 middle = 0.5 * (low + high);
  const glm::dvec3 axis = up == UpAxis::y ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  const glm::dvec3 front = up == UpAxis::y ? glm::dvec3(0, 0, 1) : glm::dvec3(0, -1, 0);

  // The upright cylinder around all vertices must fit, whatever the angle: its nearest edge is `radius` closer.
  double radius = 0, height = 0;
  for (const glm::vec3& vertex : vertices) {
    const glm::dvec3 offset = glm::dvec3(vertex) - middle;
    const double along = glm::dot(offset, axis);
    height = std::max(height, std::abs(along));
    radius = std::max(radius, glm::length(offset - along * axis));
  }
  radius += kClothes;
  height += kClothes;
  const double slope = kFilled * std::tan(kHalfView);
  // Height at the nearest edge; and the cylinder's tangents, whose sine is radius / distance.
  const double distance = std::max(height / slope + radius, radius * std::sqrt(1 + 1 / (slope * slope)));

  const double angle = degrees * std::numbers::pi / 180.0;
  const glm::dvec3 away = std::cos(angle) * front + std::sin(angle) * glm::cross(axis, front);
  const glm::dvec3 forward = -away, right = glm::normalize(glm::cross(forward, axis)),
                   down = glm::cross(forward, right);
  Camera camera;
  camera.name = fmt::format("orbit_{:g}", degrees);
  camera.width = camera.height = size;
  camera.K[0][0] = camera.K[1][1] = 0.5 * size / std::tan(kHalfView);
  camera.K[2] = {0.5 * (size - 1), 0.5 * (size - 1), 1.0};
  camera.R = glm::transpose(glm::dmat3(right, down, forward));
  camera.T = -(camera.R * (middle + distance * away));
  return camera;
}

}  // namespace arah
