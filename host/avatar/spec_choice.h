// What a capture needs of an avatar, and why (the rules of the paper's settings and of measurements with few cameras).
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "host/avatar/avatar_spec.h"
#include "host/capture/capture.h"

namespace arah {

// Frame numbers of the split "train" that a camera of the role "train" has a picture of, in the motion's order.
// Throws InputError when there is no such split or no such picture.
std::vector<int> training_frames(const Capture& capture);

struct CaptureFacts {
  std::size_t training_cameras = 0;  // with at least one picture of the split "train"
  std::size_t training_frames = 0;
  std::size_t joints = 0;
  bool single_pose = false;  // all training frames have the same rotations (the root may move)
  bool exact_poses = false;  // the capture states that its poses are the truth
  bool estimated_poses = false;  // it states that they are estimates; else it says nothing of them
  bool shape_moves_joints = false;  // the template has morph targets, and one of them moves a rest joint
};

// Looks at file names, poses, and what synthetic.json or motion_train.json state as "poses", not into pictures. Throws as training_frames() does.
CaptureFacts capture_facts(const Capture& capture);

struct SpecChoice {
  AvatarSpec spec;
  bool pose_refinement = false;      // TrainingSettings::pose_refinement
  bool shape_refinement = false;     // TrainingSettings::shape_refinement
  std::vector<std::string> reasons;  // one line a part: "part: choice, because ..."
};

// The preset without the parts that such a capture does not need. Throws InputError for an unknown preset.
SpecChoice choose_spec(const std::string& preset, const CaptureFacts& facts);

}  // namespace arah
