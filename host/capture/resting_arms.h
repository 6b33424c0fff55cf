// How a person's arms rest, and generated people who rest so: the canonical pose keeps the arms as they are at rest
// (canonical.h), so a prior of people in T-pose knows nothing of arms that hang.
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <string>

#include "host/capture/synthetic_figure.h"

namespace arah {

// Unit directions of shoulder → elbow → wrist → hand at rest, of the left arm and the right one; in the template's axes.
struct RestingArms {
  std::array<std::array<glm::dvec3, 3>, 2> bones;
};

// Throws InputError naming `where` and the joint where the skeleton lacks one of SMPL's arms or a bone has no length.
RestingArms resting_arms(const Skeleton& skeleton, const std::string& where);

// The figure resting with such arms: body, surface and joints are taken there by skinning, each bone by the shortest turn, and
// that is its rest from then on. Colours of the arms (ClothedFigure::average_place) are another rest's. The figure has SMPL's
// arms.
void rest_with(ClothedFigure& figure, const RestingArms& arms);

}  // namespace arah
