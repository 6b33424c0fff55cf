// A pose and forward kinematics. All matrices act on column vectors; angles are radians, lengths metres.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "host/body/body_template.h"
#include "host/body/skeleton.h"

namespace arah {

// theta[j]: rotation of joint j relative to its parent, axis times angle; theta[0] is the global orientation.
// root_position: world position of joint 0.
struct Pose {
  std::vector<glm::dvec3> theta;  // [J]
  glm::dvec3 root_position{0.0};

  bool operator==(const Pose&) const = default;
};

// The pose that leaves the skeleton as it rests.
Pose rest_pose(const Skeleton& skeleton);

// Rodrigues' formula R = I + a K + b K², with K the cross-product matrix of the axis-angle itself, a = sin t / t and
// b = (1 − cos t) / t² written as sin²(t/2) / (t²/2), which loses nothing near 0; exact rotations at any angle.
glm::dmat3 rotation_from_axis_angle(const glm::dvec3& axis_angle);

// Its inverse, angle in [0, π]; stable at 0 and at π (through the unit quaternion's largest component).
glm::dvec3 axis_angle_from_rotation(const glm::dmat3& rotation);

// The shortest turn of one unit vector to another; about any axis across it where they are opposite.
glm::dmat3 shortest_turn(const glm::dvec3& from, const glm::dvec3& to);

// G_j: joint frame → posed world without the global translation, [J]. The root stays where it rests:
// G_0 = [R_0 | J_0], G_j = G_parent [R_j | J_j − J_parent]. The posed joint is the translation of G_j.
// Throws std::invalid_argument if the pose has another number of joints.
std::vector<glm::dmat4> forward_kinematics(const Skeleton& skeleton, const Pose& pose);

// A_b = G_b T(−J_b): rest → posed without the global translation, [J] (ARAH.md §1).
std::vector<glm::dmat4> rest_to_posed(const Skeleton& skeleton, const Pose& pose);

// The global translation t = root_position − J_0 (SMPL's `trans`): world = (Σ w_b A_b) x_rest + t.
glm::dvec3 root_translation(const Skeleton& skeleton, const Pose& pose);

// The template's vertices in the pose, in the world, with the root translation, [V].
std::vector<glm::vec3> posed_vertices(const BodyTemplate& body_template, const Pose& pose);

// Linear blend skinning of the template's vertices with any per-bone transforms [J], [V].
std::vector<glm::dvec3> skinned_vertices(const BodyTemplate& body_template, const std::vector<glm::dmat4>& transforms);

// The rotations of all joints but the root, relative to their parents, row by row, [J − 1][9]: what networks read of a pose.
std::vector<float> joint_rotations(const Pose& pose);

}  // namespace arah
