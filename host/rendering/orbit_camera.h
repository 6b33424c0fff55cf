// A camera that circles a body and holds it in view.
#pragma once

#include <glm/vec3.hpp>
#include <span>
#include <string>

#include "host/capture/camera.h"

namespace arah {

enum class UpAxis { y, z };  // of the rest pose; of a capture's world

// A square camera of `size` pixels with a field of view of 30°, aimed level at the middle of the vertices' box. Its
// distance is the same for all angles and leaves 10 cm around the body for clothes and hair, and a twentieth of the
// picture around that. 0° looks at the side that faces +Z with +Y up, -Y with +Z up: a person at rest from the front;
// positive degrees go counter-clockwise seen from above. Throws std::invalid_argument without vertices or size.
Camera orbit_camera(std::span<const glm::vec3> vertices, UpAxis up, double degrees, int size);

}  // namespace arah
