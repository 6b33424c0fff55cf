// A hand takes a joint and pulls: which turns of the joints above it bring it there.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "host/body/pose.h"
#include "host/body/skeleton.h"

namespace arah {

// Where a pose puts the joints, metres, world, [J]. Throws std::invalid_argument as forward_kinematics() does.
std::vector<glm::dvec3> posed_joints(const Skeleton& skeleton, const Pose& pose);

// The rotation as axis times angle, of all its representations (turns by 2π apart) the nearest to `near`: numbers that are shown do not jump
// where an angle passes π.
glm::dvec3 axis_angle_near(const glm::dmat3& rotation, const glm::dvec3& near);

// The pose with one joint, and all that hangs from it, turned about it by an axis-angle in the world's axes.
Pose turned_in_world(const Skeleton& skeleton, const Pose& pose, int joint, const glm::dvec3& turn);

// The joints that turn when `joint` is dragged, nearest first: its ancestors, at most `most` of them. The first from which other limbs hang
// too, and the root, end the list, and are in it only where they come first: who pulls a wrist turns elbow and shoulder, who pulls a knee the
// hip alone and not the person. Empty for the root. Throws std::out_of_range for a joint that the skeleton lacks.
std::vector<int> turning_joints(const Skeleton& skeleton, int joint, int most = 2);

// ∂x/∂ω_i = −[x − c_i]×, metres a radian, one for each of `turning`: the way of the joint at x when a joint above it, at c_i, turns by ω_i about
// the world's axes; x(ω) = x + Σ_i ω_i × (x − c_i) to first order.
std::vector<glm::dmat3> joint_jacobian(const Skeleton& skeleton, const Pose& pose, int joint, std::span<const int> turning);

// The pose with `joint` at `target` (metres, world), or, where that is out of reach, at the nearest point that the turning joints reach with the
// lengths of the bones between. Other joints keep their numbers, the root its place; the root itself, dragged, moves the person. Damped least squares
// (Wampler 1986; Nakamura and Hanafusa 1986), ω = Jᵀ (J Jᵀ + λ² I)⁻¹ e, of all ways to get there one of small turns, with a damping that
// goes with the distance left: it bounds the turns far away and where the chain is straight, and vanishes at the target. A fixed
// number of such steps, each of at most 0.3 rad, without a branch: the pose follows the target continuously. Only where no turn brings the joint
// nearer to first order, as with a straight chain that is pushed along itself, the last joint is bent a little, one of all ways.
// A target or a pose that is not finite changes nothing. Throws as turning_joints() and forward_kinematics() do.
Pose dragged(const Skeleton& skeleton, const Pose& pose, int joint, const glm::dvec3& target, int most_turning = 2);

}  // namespace arah
