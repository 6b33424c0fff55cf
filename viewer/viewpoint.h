// Where one looks from: a camera that circles a point, and what a hand does to it.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>

#include "host/capture/camera.h"
#include "host/rendering/orbit_camera.h"

namespace arah {

// At yaw and pitch 0 the camera is in front of a person at rest, as orbit_camera() at 0°.
struct Viewpoint {
  glm::dvec3 target{0.0};      // metres, world: seen in the middle of the picture
  UpAxis up = UpAxis::y;       // of the world
  double yaw = 0;              // radians, counter-clockwise seen from above
  double pitch = 0;            // radians above the horizon, within ±89°
  double distance = 3;         // metres, 0.05 to 100
  double field_of_view = 0.5;  // radians from top to bottom, 0.05 to 2.5

  bool operator==(const Viewpoint&) const = default;
};

// In front of the posed vertices, all of them in view. Throws std::invalid_argument without vertices.
Viewpoint viewpoint_around(std::span<const glm::vec3> vertices, UpAxis up);

// From where a camera stands, looking at the target as it stands upright: not the camera's roll, nor its axis where that misses the target.
Viewpoint viewpoint_of(const Camera& camera, const glm::dvec3& target, UpAxis up);

// Throws std::invalid_argument unless both sizes are in 1..8192.
Camera camera_at(const Viewpoint& viewpoint, int width, int height);

// The target follows the hand: moved by so many pixels of a picture of that height, the point under the cursor stays under it.
Viewpoint panned(const Viewpoint& viewpoint, glm::dvec2 pixels, int height);
// By so many pixels; half a turn for a picture's height. A hand that moves right turns what it holds to the right.
Viewpoint orbited(const Viewpoint& viewpoint, glm::dvec2 pixels, int height);
// Nearer by `notches` of a wheel, a tenth each.
Viewpoint dollied(const Viewpoint& viewpoint, double notches);

}  // namespace arah
