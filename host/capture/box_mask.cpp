// The image region of a body's bounding box.
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "host/capture/capture.h"

namespace arah {
namespace {

constexpr double kNear = 1e-4;         // metres in front of the camera at which faces are cut
constexpr double kFarPixel = 1 << 20;  // coordinates beyond this are outside any picture (and would overflow the fill)

// The part of a convex polygon, in camera coordinates, that lies in front of the camera (Sutherland–Hodgman, one
// plane).
std::vector<glm::dvec3> in_front(const std::array<glm::dvec3, 4>& face) {
  std::vector<glm::dvec3> kept;
  for (std::size_t i = 0; i < face.size(); ++i) {
    const glm::dvec3& a = face[i];
    const glm::dvec3& b = face[(i + 1) % face.size()];
    if (a.z >= kNear) kept.push_back(a);
    if ((a.z >= kNear) != (b.z >= kNear)) kept.push_back(a + (b - a) * ((kNear - a.z) / (b.z - a.z)));
  }
  return kept;
}

int pixel(double coordinate) {
  return static_cast<int>(std::lrint(std::clamp(coordinate, -kFarPixel, kFarPixel)));
}

}  // namespace

PixelMask projected_box_mask(const Camera& camera, std::span<const glm::vec3> vertices, double margin) {
  PixelMask mask{camera.width, camera.height, {}};
  cv::Mat filled(camera.height, camera.width, CV_8U, cv::Scalar(0));
  if (!vertices.empty()) {
    glm::dvec3 least(vertices[0]), greatest(vertices[0]);
    for (const glm::vec3& vertex : vertices) {
      least = glm::min(least, glm::dvec3(vertex));
      greatest = glm::max(greatest, glm::dvec3(vertex));
    }
    least -= margin;
    greatest += margin;
    for (int axis = 0; axis < 3; ++axis) {
      const int p = (axis + 1) % 3, q = (axis + 2) % 3;
      for (const glm::dvec3& side : {least, greatest}) {
        std::array<glm::dvec3, 4> face;
        for (std::size_t i = 0; i < 4; ++i) {
          glm::dvec3 corner;
          corner[axis] = side[axis];
          corner[p] = i == 1 || i == 2 ? greatest[p] : least[p];
          corner[q] = i >= 2 ? greatest[q] : least[q];
          face[i] = camera.to_camera(corner);
        }
        std::vector<cv::Point> outline;
        for (const glm::dvec3& corner : in_front(face)) {
          const glm::dvec3 projected = camera.K * corner;
          outline.emplace_back(pixel(projected.x / projected.z), pixel(projected.y / projected.z));
        }
        if (!outline.empty()) cv::fillPoly(filled, std::vector<std::vector<cv::Point>>{outline}, cv::Scalar(1));
      }
    }
  }
  mask.inside.assign(filled.data, filled.data + filled.total());
  return mask;
}

}  // namespace arah
