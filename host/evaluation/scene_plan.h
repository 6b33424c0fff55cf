// Where a capture's cameras stand, where they look and where the body goes, as drawings to scale.
#pragma once

#include <string>

#include "host/capture/capture.h"

namespace arah {

enum class PlanView {
  above,  // x to the right, y up the page
  front   // x to the right, z up the page: seen along +y, as a person at rest is who looks along -y
};

// `<svg ...>...</svg>`, 720 units wide, one scale for both axes, metres along them; the names of cameras, the way that they look, their fields
// of view (horizontal from above, vertical from the front), the path of each split's root over its frames, and the template in the first pose of the first split. Places
// beyond 1e9 m leave the words "too far apart to be drawn". Every text is escaped.
std::string scene_plan_svg(const Capture& capture, PlanView view);

}  // namespace arah
