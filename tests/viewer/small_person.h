// A person of SMPL's joints in front of a camera, for the tests of what is drawn over pictures and dragged in them.
#pragma once

#include <cstddef>
#include <string>

#include "host/body/pose.h"
#include "host/body/smpl_joints.h"
#include "host/capture/camera.h"
#include "viewer/viewpoint.h"

namespace arah {

inline std::size_t joint_named(const Skeleton& skeleton, const std::string& name) { return static_cast<std::size_t>(find_joint(skeleton, name)); }

// 1.7 m, arms 45 degrees down and a little bent, metres.
inline Skeleton smpl_person() {
  Skeleton person{smpl_joint_names(24, ""), smpl_joint_parents(24, ""), std::vector<glm::dvec3>(24)};
  const auto put = [&](const std::string& name, glm::dvec3 place) { person.rest_joints[joint_named(person, name)] = place; };
  put("pelvis", {0, 0.95, 0.01});
  put("spine1", {0, 1.06, -0.01});
  put("spine2", {0, 1.19, 0});
  put("spine3", {0, 1.25, 0.01});
  put("neck", {0, 1.46, -0.02});
  put("head", {0, 1.55, 0.03});
  for (const double s : {1.0, -1.0}) {
    const std::string side = s > 0 ? "left_" : "right_";
    put(side + "hip", {0.07 * s, 0.86, 0.01});
    put(side + "knee", {0.1 * s, 0.48, 0.02});
    put(side + "ankle", {0.1 * s, 0.08, -0.02});
    put(side + "foot", {0.12 * s, 0.02, 0.1});
    put(side + "collar", {0.08 * s, 1.37, 0.01});
    put(side + "shoulder", {0.17 * s, 1.4, 0.01});
    put(side + "elbow", {0.35 * s, 1.21, -0.01});
    put(side + "wrist", {0.52 * s, 1.04, 0.03});
    put(side + "hand", {0.58 * s, 0.98, 0.04});
  }
  return person;
}

// 4 m in front of the middle of a person at rest, 640 x 480.
inline Camera camera_in_front() {
  Viewpoint viewpoint;
  viewpoint.target = {0, 0.9, 0};
  viewpoint.distance = 4;
  return camera_at(viewpoint, 640, 480);
}

}  // namespace arah
