// A motion of one skeleton for another: by joint names, whatever their spelling, and whatever pose either rests in.
#pragma once

#include <glm/mat3x3.hpp>
#include <string>
#include <vector>

#include "host/body/motion.h"

namespace arah {

struct NamedJoint {
  std::string name;  // SMPL's
  int joint = -1;
};
// SMPL's names of a skeleton's joints, those that are known by theirs: "mixamorig:LeftUpLeg", "lThigh", "LeftHip" and
// "thigh.L" are left_hip. Known are SMPL's own names and those of Mixamo, CMU, MotionBuilder, Rokoko, Poser and Blender rigs.
// A name of two meanings means what the others leave: LeftShoulder is the collar beside LeftArm and the shoulder beside
// LeftElbow. Joints between hips and neck, n of them along the spine, serve as spine1 to spine3: number ceil(k n / 3) from
// below as spine k, so that each name has one, and one joint may have to serve for several.
std::vector<NamedJoint> smpl_names(const Skeleton& skeleton);

// The axes that a skeleton rests along, columns: to its left, up from ankles to hips, ahead; those nearest to them of its space.
// The identity, SMPL's, where legs are missing.
glm::dmat3 rest_axes(const Skeleton& skeleton);

struct RetargetSettings {
  double scale = 0;                 // of the root's way; 0: the ratio of the legs' lengths
  double same_rest_degrees = 0.01;  // limbs that rest closer than this, all of them, count as resting alike: files round
};

struct Retargeted {
  Motion motion;             // of the target's skeleton
  std::vector<int> sources;  // [target's joints] the joint whose rotation it takes; -1: stays at rest relative to its parent
  double scale = 1;
  bool same_rest = false;    // no limb needed a correction
};

// Rotations are taken over in the world. With R the rotation of a joint from its rest, in the world, and s(j) the joint of the
// source that has the name of j:
//   R_target(j) = R_source(s(j)) D_j,    D_j = T_j D_0
// D_0 turns the target's axes at rest into the source's (rest_axes), by multiples of 90 degrees. T_j is
// the shortest turn that takes D_0 (target's direction at rest) to the source's direction at rest, for the bones of limbs: hip to knee to
// ankle, shoulder to elbow to wrist. These point in the source's directions in every frame. All else rests alike in a T-pose and in
// an A-pose: trunk, neck, head, collars and feet have T = 1; hands and what hangs below them take their parent's D, because
// they rest in line with the arm. Rotations relative to parents follow from R.
// The root goes where the middle between the hips goes, times `scale`: root = scale m_source − R_target(0) (m_target − J_0),
// m_target at rest; roots take the place of these middles where hips are missing. Worlds are the same.
// Throws InputError naming `where`: a source without the target's root or with fewer than three of its joints, legs
// without length where no scale is given, results that are not finite.
Retargeted retarget(const Motion& source, const Skeleton& target, const RetargetSettings& settings, const std::string& where);

// "target  source" a line, for printing, and what stays at rest.
std::string retarget_table(const Retargeted& result, const Skeleton& source);

// --- Frames of a motion. All number frames from 0.

// Frames first, first + step, … before `end`. Throws InputError naming `where` where there is none of these.
Motion cut(const Motion& motion, std::size_t first, std::size_t end, std::size_t step, const std::string& where);

// At another rate over the same time: rotations between frames by spherical, root positions by linear interpolation.
// Throws InputError naming `where` where the motion's rate is not known or more than 10 million frames would come out.
Motion resampled(const Motion& motion, double frames_per_second, const std::string& where);

// The frames `times` over, each time from where the motion began. Throws InputError as above.
Motion looped(const Motion& motion, int times, const std::string& where);

// Moved so that the first frame's root stands above (x, y) of the +Z-up world; heights change only where `place` has a third number,
// the root's.
Motion placed(const Motion& motion, const std::vector<double>& place);

}  // namespace arah
