// Poses of training frames that training has corrected (paper, appendix "Pose and Shape Optimization"), kept with the avatar.
#pragma once

#include <string>
#include <vector>

#include "host/avatar/safetensors.h"
#include "host/body/body_template.h"
#include "host/body/motion.h"

namespace arah {

// Empty where training took the poses as they were given.
struct RefinedPoses {
  std::vector<int> frames;   // numbers of the frames that training had pictures of, distinct
  std::vector<Pose> poses;   // one each
  std::vector<Pose> starts;  // what they were before training
  std::vector<double> start_shape;  // the body's β before training, where that was refined too (Avatar::body has it as it is now)

  bool empty() const { return frames.empty(); }
  bool operator==(const RefinedPoses&) const = default;
};

// Tensors "refined.frames" [F] (I64), "refined.theta" [F, J, 3] and "refined.root_position" [F, 3] (F64), and the same with
// "refined.start_"; "refined.start_shape" [B] (F64) where the shape was refined; nothing where there are none. Reading gives
// what was written, bit for bit; throws InputError naming what does not fit the body.
void put_refined_poses(SafetensorsFile& file, const RefinedPoses& refined);
RefinedPoses read_refined_poses(const SafetensorsFile& file, const BodyTemplate& body);
// A body's β: "template.shape" [B] (F64); nothing without morph targets.
void put_shape(SafetensorsFile& file, const BodyTemplate& body);
void read_shape(const SafetensorsFile& file, BodyTemplate* body);

// The refined pose of a training frame, else the one that the frame has: poses of other splits are what was asked for.
const Pose& pose_to_render(const RefinedPoses& refined, const std::string& split, const MotionFrame& frame);

// How far poses are from others of the same frames.
struct PoseDistance {
  std::size_t frames = 0;
  double joints = 0;     // mean distance of joints in the world, metres
  double rotations = 0;  // mean angle between rotations of joints relative to their parents, radians
};
// The second poses are of `other`, a skeleton of as many joints. Throws std::invalid_argument unless there are equally many
// poses, with the skeletons' joints.
PoseDistance pose_distance(const Skeleton& skeleton, const std::vector<Pose>& poses, const Skeleton& other, const std::vector<Pose>& others);

// How far the frames' poses were from a motion's before training and are now, of a body in the shape that it had and that it
// has, against the true skeleton; frames that the motion lacks do not count.
struct PoseImprovement {
  PoseDistance before, after;
};
PoseImprovement pose_improvement(const RefinedPoses& refined, const BodyTemplate& body, const Skeleton& truth, const Motion& motion);
// "poses: joints 31.20 mm from the capture's before training, 12.10 mm after; rotations 3.00° and 1.20° (20 frames)".
std::string describe(const PoseImprovement& improvement);

}  // namespace arah
