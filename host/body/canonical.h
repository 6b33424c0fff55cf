// The canonical pose, in which the avatar's fields live, and the cube that it is normalised to (ARAH.md §1).
#pragma once

#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <utility>
#include <vector>

#include "host/body/body_template.h"
#include "host/body/pose.h"
#include "host/body/skeleton.h"

namespace arah {

// V_b: rest → canonical, one rigid transform per bone, [J].
struct CanonicalPose {
  std::vector<glm::dmat4> rest_to_canonical;
};

// Rigs with SMPL's leg names: each leg is turned outward rigidly about the front axis (z) at the hip, the left one
// towards +x. From a T-pose (upper arms within 20° of the horizontal) by exactly 45°, as the paper's star pose; from
// another rest until the thigh (hip → knee) stands 45° off the vertical, never inward. Other rigs: the rest pose.
CanonicalPose make_canonical_pose(const Skeleton& skeleton);

// B_b = A_b V_b⁻¹: canonical → posed, without the root translation, [J].
std::vector<glm::dmat4> bone_transforms(const Skeleton& skeleton, const CanonicalPose& canonical, const Pose& pose);

// Σ_b w_b V_b applied to the template's rest vertices, [V].
std::vector<glm::dvec3> canonical_vertices(const BodyTemplate& body_template, const CanonicalPose& canonical);

// Where each bone lies in the canonical pose: from its joint to the middle of its children's, or the joint alone without any;
// metres, [J].
std::vector<std::pair<glm::dvec3, glm::dvec3>> bone_segments(const Skeleton& skeleton, const CanonicalPose& canonical);

// The isotropic map of canonical metres to the cube [−1, 1]³ with 5 % padding on each side:
// n(x) = 2 ((x − center) − cmin + 0.05 r) / (1.1 r) − 1 with r = cmax − cmin; cmin and cmax are the least and greatest
// coordinate of all vertices relative to their mean `center`, over all axes together.
struct CubeNormalization {
  glm::dvec3 center{0.0};
  double cmin = -1.0;
  double cmax = 1.0;

  glm::dvec3 to_cube(const glm::dvec3& x) const;
  glm::dvec3 from_cube(const glm::dvec3& n) const;
  // Metres to a unit of the cube: an SDF value in the cube times this is a distance in metres.
  double metres_per_unit() const { return 1.1 * (cmax - cmin) / 2.0; }
};

// The normalisation of a set of canonical vertices. Throws InputError if they have no extent.
CubeNormalization cube_normalization(std::span<const glm::dvec3> vertices);

}  // namespace arah
