// A sequence of poses for a skeleton, and its native file, motion_<split>.json.
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "host/body/pose.h"
#include "host/body/skeleton.h"

namespace arah {

struct MotionFrame {
  int number = 0;  // the frame's number in the capture; unique in a motion, not necessarily consecutive
  Pose pose;
  std::string source;  // where the pose came from, free text
};

struct Motion {
  std::string split;
  std::string poses;  // what the file says of its poses: "exact", "estimated", or nothing
  Skeleton skeleton;  // the joints that the poses refer to, as the file states them
  std::vector<MotionFrame> frames;
  double frames_per_second = 0;  // 0: not known
};

// What a file may state, all frames together: joints, and five more a frame for the rest of it, of 24 bytes each. 22 joints: half an
// hour of 120 frames a second. A line of a BVH file may state hundreds of joints that do not move.
inline constexpr std::size_t kMostMotionJoints = 6'000'000;
// Throws InputError naming `where` and `field` beyond that.
void check_motion_size(std::size_t frames, std::size_t joints, const std::string& where, const std::string& field);

// Reads the native JSON: `joint_names`, `parents`, `joint_rest` (metres) and `frames`, each with `frame` (number),
// `theta` [J][3] axis-angles and `root_position` (or `trans` = root_position − joint_rest[0]); `split`, `source`,
// `poses` and `fps` are optional. Throws InputError naming file, frame and field: missing or truncated file, missing fields, numbers that are
// not finite, a wrong count of rotations, frames given twice, no frames, shape coefficients (`betas`) other than 0.
Motion read_motion(const std::filesystem::path& path);

// Writes the same format, with `trans` beside `root_position`. Doubles are written so that they read back exactly.
// Throws std::runtime_error when the disk refuses.
void write_motion(const std::filesystem::path& path, const Motion& motion);

// The motion with its rotations in the order of `skeleton`, matched by joint name; joints that the motion does not have
// rest (zero rotation). Root positions are kept. Throws InputError naming `where` and the joint if the motion has a
// joint that the skeleton lacks, or the same joint under another parent.
Motion adapt_motion(const Motion& motion, const Skeleton& skeleton, const std::string& where);

// The frame with this number, or nullptr.
const MotionFrame* find_frame(const Motion& motion, int number);

}  // namespace arah
